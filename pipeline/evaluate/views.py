"""What a policy is shown besides its joints: the images of the dataset's cameras, and a sentence."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.data.names import HEAD, SIDES
from pipeline.stages.render import appearance_of, renderer
from pipeline.stages.scene import Scene
from pipeline.tasks.language import instructions
from pipeline.world.simulation import Simulation
from pipeline.world.visuals import draw_visuals

CAMERAS = (HEAD, *(f"{side}_camera" for side in SIDES))
"""Names of the dataset's cameras."""


class Eyes:
    """The cameras of a scene, drawing a running simulation. In the randomized domain they see surfaces that training never shows.

    `depth` holds, where it is asked for, the depth images (H,W) uint16 in mm along the viewing axis (0: nothing there) by camera
    of the last look.

    Raises NoRenderer where nothing can draw. Close it after.
    """

    def __init__(self, scene: Scene, cameras: tuple[str, ...], camera_type: str = "D435", preset: str = "raster") -> None:
        looks = draw_visuals(scene.spec.rng("visuals"), scene.spec.domain, "unseen")
        appearance = replace(appearance_of(scene, camera=camera_type, preset=preset), visuals=looks).seen_by(*cameras)
        self._renderer = renderer(appearance)
        self.depth: dict[str, NDArray[np.uint16]] = {}

    def look(self, simulation: Simulation, *, depth: bool = False) -> dict[str, NDArray[np.uint8]]:
        """Images (H,W,3) uint8 RGB by camera, of the simulation as it is now."""
        poses = dict(zip(simulation.names, simulation.poses()[:, None], strict=True))
        views = self._renderer.render(poses, depth=depth)
        self.depth = {view.camera.name: view.depth[0] for view in views if view.depth is not None}
        return {view.camera.name: view.rgb[0] for view in views}

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


def instruction_of(scene: Scene, split: str = "unseen") -> str:
    """The instruction of an episode, of the split "seen" or "unseen"."""
    return instructions(scene.wording(), scene.spec.rng("language"), 1)[split][0]

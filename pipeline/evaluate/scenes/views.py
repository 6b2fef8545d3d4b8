"""What a policy is shown besides its joints: the images of a setup's cameras, and a sentence."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.events import spans
from pipeline.data.names import HEAD
from pipeline.data.setup import Setup
from pipeline.stages.drawing.exposure import Lapses, photograph
from pipeline.stages.drawing.render import appearance_of, renderer
from pipeline.stages.scene import Scene
from pipeline.tasks.language.sentences import instructions
from pipeline.world.cameras import check_links
from pipeline.world.drawing.sensing import point_clouds
from pipeline.world.physics.recorder import Recorder


@dataclass(eq=False)
class CameraViews:
    """What cameras show of one moment, as in Observation."""

    images: dict[str, NDArray[np.uint8]] = field(default_factory=dict[str, NDArray[np.uint8]])
    depth: dict[str, NDArray[np.uint16]] = field(default_factory=dict[str, NDArray[np.uint16]])
    segmentation: dict[str, NDArray[np.uint8]] = field(default_factory=dict[str, NDArray[np.uint8]])
    pointcloud: NDArray[np.float32] | None = None


class Eyes:
    """The cameras of a setup in a scene, drawing a running simulation; close it after. Raises
    NoRenderer."""

    def __init__(self, scene: Scene, setup: Setup) -> None:
        appearance = appearance_of(scene, setup)
        check_links(appearance.cameras, [*appearance.bodies, "table"])
        self._renderer, self._setup, self._sensing = renderer(appearance), setup, appearance.sensing
        self._events = appearance.events

    def look(self, recorder: Recorder) -> CameraViews:
        """The view of the running simulation now."""
        setup, past = self._setup, recorder.past
        poses = {name: past[:, i] for i, name in enumerate(recorder.simulation.names)}
        sensors = {"depth": setup.depth or setup.pointcloud, "segmentation": setup.segmentation}
        lapses = Lapses(spans(self._events, recorder.simulation.events), setup.fps)
        views = photograph(self._renderer, poses, [len(past) - 1], self._sensing, lapses, **sensors)
        seen = CameraViews({view.camera.name: view.rgb[0] for view in views})
        for view in views:
            if setup.depth and view.depth is not None:
                seen.depth[view.camera.name] = view.depth[0]
            if view.segmentation is not None:
                seen.segmentation[view.camera.name] = view.segmentation[0]
            if setup.pointcloud and view.camera.name == HEAD:
                seen.pointcloud = point_clouds(view)[0]
        return seen

    def close(self) -> None:
        self._renderer.close()


def instruction_of(scene: Scene, split: str = "unseen") -> str:
    """The instruction of an episode, of the split "seen" or "unseen"."""
    if scene.sentences:
        return scene.sentences[split]
    return instructions(scene.wording(), scene.spec.rng("language"), 1)[split][0]

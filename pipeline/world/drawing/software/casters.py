"""The sun's view of bodies, drawn by the processor."""

from collections.abc import Mapping, Set

import numpy as np
from numpy.typing import NDArray

from pipeline.poses import IDENTITY, Floats, Pose
from pipeline.world.shapes import Mesh

from .changes import surrounding
from .light import NEAREST, Sunlight
from .raster import Floats32, fill_depths, solids_of


class SoftwareCasters:
    """Draws depths (N,N) along the light, which `move` (3,4) takes world places to. Without any
    body there are no shadows. Starts with these depths and masks."""

    def __init__(
        self,
        moving: Mapping[str, Mesh],
        fixed: Mesh | None,
        move: Floats,
        depths: Floats32,
        masks: NDArray[np.uint8],
    ) -> None:
        meshes = [*moving.values(), *([] if fixed is None else [fixed])]
        self._order = {name: k for k, name in enumerate(moving)}
        self._solids, self._move = solids_of(meshes), move
        self._poses = np.tile(np.asarray(IDENTITY, float), (len(meshes), 1))
        self._shown = np.zeros(0, int)
        around = np.empty((2, *(n // NEAREST for n in depths.shape)), np.float32)
        words, drawn = masks.view(np.uint32)[..., 0], bool(meshes)
        flat = move.astype(np.float32)
        self.sunlight = Sunlight(depths.copy(), around[0], around[1], flat, words, drawn)
        self.upload(depths, masks)

    def upload(self, depths: Floats32, masks: NDArray[np.uint8]) -> None:
        """Look shadows up in these depths; the masks are those given at first."""
        np.copyto(self.sunlight.depths, depths)
        surrounding(self.sunlight.depths, self.sunlight.least, self.sunlight.most)

    def place(self, name: str, pose: Pose) -> None:
        """Set the world pose (7,) of a body."""
        self._poses[self._order[name]] = pose

    def show(self, names: Set[str], fixed: bool) -> None:
        """Hide all other bodies."""
        still = range(len(self._order), len(self._poses)) if fixed else ()
        self._shown = np.array([*(k for n, k in self._order.items() if n in names), *still], int)

    def take(self, behind: Floats32) -> Floats32:
        """Depths of what is shown, or those behind where they are less."""
        depths = behind.copy()
        fill_depths(self._solids, self._shown, self._poses, self._move, depths)
        return depths

    def close(self) -> None:
        """Nothing is held outside."""

"""The sun's view of bodies, drawn by the processor."""

from collections.abc import Mapping, Set

import numpy as np

from pipeline.poses import IDENTITY, Floats, Floats32, Ints, Pixels, Pose
from pipeline.world.shapes import Mesh

from .changes import surrounding
from .kernels import kernel
from .light import NEAREST, Sunlight
from .raster import Ids, Solids, joined, solids_of


class SoftwareCasters:
    """Draws depths (N,N) along the light, which `move` (3,4) takes world places to. Without any
    body there are no shadows. Starts with these depths and masks."""

    def __init__(
        self,
        moving: Mapping[str, Mesh],
        fixed: Mesh | None,
        move: Floats,
        depths: Floats32,
        masks: Pixels,
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

    def upload(self, depths: Floats32, masks: Pixels) -> None:
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


@kernel
def fill_depths(solids: Solids, shown: Ints, poses: Floats, view: Floats, depths: Floats32) -> None:
    """Least depth (N,N) of triangles that are turned away from the light, of the bodies that are
    shown. `view` (3,4) takes the world to column, row and depth."""
    turn, at = view[:, :3].copy(), view[:, 3].copy()
    seen = np.empty((len(solids.points), 3), np.float32)
    for k in shown:
        first, last = solids.spans[k, 0], solids.spans[k, 1]
        move = joined(turn, at, poses[k])
        for i in range(first, last):
            a, b, c = solids.points[i, 0], solids.points[i, 1], solids.points[i, 2]
            for j in range(3):
                seen[i, j] = move[j, 0] * a + move[j, 1] * b + move[j, 2] * c + move[j, 3]
        _fill_depths(solids.corners, (solids.spans[k, 2], solids.spans[k, 3]), seen, depths)


@kernel
def _fill_depths(corners: Ids, span: tuple[int, int], seen: Floats32, depths: Floats32) -> None:
    size = depths.shape[0]
    for t in range(span[0], span[1]):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        x0, y0, z0 = seen[i, 0], seen[i, 1], np.float64(seen[i, 2])
        x1, y1, z1 = seen[j, 0], seen[j, 1], np.float64(seen[j, 2])
        x2, y2, z2 = seen[k, 0], seen[k, 1], np.float64(seen[k, 2])
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area >= 0:
            continue
        half = np.float32(0.5)
        low_x = max(int(np.ceil(min(x0, x1, x2) - half)), 0)
        high_x = min(int(np.floor(max(x0, x1, x2) - half)), size - 1)
        low_y = max(int(np.ceil(min(y0, y1, y2) - half)), 0)
        high_y = min(int(np.floor(max(y0, y1, y2) - half)), size - 1)
        if low_x > high_x or low_y > high_y:
            continue
        part = 1 / np.float64(area)
        step_u, step_v = (y2 - y0) * part, (y0 - y1) * part
        u_y, v_y = (x0 - x2) * part, (x1 - x0) * part
        for y in range(low_y, high_y + 1):
            dx, dy = low_x + 0.5 - x0, y + 0.5 - y0
            u, v = step_u * dx + u_y * dy, step_v * dx + v_y * dy
            for x in range(high_x - low_x + 1):
                here_u, here_v = u + step_u * x, v + step_v * x
                if here_u >= 0 and here_v >= 0 and here_u + here_v <= 1:
                    depth = np.float32(z0 + here_u * (z1 - z0) + here_v * (z2 - z0))
                    if depth < depths[y, low_x + x] and depth >= 0:
                        depths[y, low_x + x] = depth

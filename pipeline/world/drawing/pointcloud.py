"""Point clouds of the table's workspace from the head camera's depth and colour, thinned by
farthest point sampling."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.data.cameras import View, intrinsics
from pipeline.poses import quat_rotate
from pipeline.world.physics.body import TABLE_HALF, TABLE_TOP

POINTS = 1024
ABOVE, HIGHEST = 0.005, 1.0
"""m over the table top between which points count: the top itself would take most of them."""

COLUMNS = 320
"""About how many columns of an image are read: of one twice as wide every second pixel of every
second row."""


def point_clouds(view: View, count: int = POINTS) -> NDArray[np.float32]:
    """Clouds (T,count,6): x y z (m, world) and r g b (0-1) of what stands on the table or reaches
    over it.

    `view` needs depth. The first k points are the farthest point sample of size k; fewer pixels are
    repeated in turn, and where there are none all is zero.
    """
    assert view.depth is not None
    step = max(1, view.camera.type.width // COLUMNS)
    rays = _rays(view)[::step, ::step]
    clouds = np.zeros((len(view.rgb), count, 6), np.float32)
    half = np.array([*TABLE_HALF, 0.0])
    lower, upper = (
        np.array([0, 0, TABLE_TOP + ABOVE]) - half,
        np.array([0, 0, TABLE_TOP + HIGHEST]) + half,
    )
    depths, images = view.depth[:, ::step, ::step], view.rgb[:, ::step, ::step]
    for cloud, depth, rgb, pose in zip(clouds, depths, images, view.poses, strict=True):
        points = quat_rotate(pose[3:], rays * (depth[..., None] * 1e-3)) + pose[:3]
        inside = (depth > 0) & ((points >= lower) & (points <= upper)).all(-1)
        candidates = points[inside].astype(np.float32)
        if len(candidates):
            taken = farthest_points(candidates, min(count, len(candidates)))
            order = np.resize(taken, count)
            cloud[:, :3], cloud[:, 3:] = candidates[order], rgb[inside][order] / np.float32(255.0)
    return clouds


def _rays(view: View) -> NDArray[np.float64]:
    """Rays (H,W,3) of the pixel centres for a depth of 1: x forward, y left, z up."""
    kind = view.camera.type
    k = intrinsics(kind)
    u, v = np.arange(kind.width) + 0.5, (np.arange(kind.height) + 0.5)[:, None]
    left, up = (k[0, 2] - u) / k[0, 0], (k[1, 2] - v) / k[1, 1]
    return np.stack(np.broadcast_arrays(1.0, left, up), -1)


@njit(cache=True, error_model="numpy")
def farthest_points(points: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Indices (count,) of points (N,3), N >= count: the first point, then each time the one
    farthest from all taken, of several the first."""
    x, y, z = (
        np.ascontiguousarray(points[:, 0]),
        np.ascontiguousarray(points[:, 1]),
        np.ascontiguousarray(points[:, 2]),
    )
    taken = np.zeros(count, np.int64)
    # squared distances, never negative: their bits are in their order
    gap = np.full(len(points), np.inf, np.float32)
    bits = gap.view(np.int32)
    last = 0
    for i in range(1, count):
        # two plain loops, which compile to vector instructions
        for j in range(len(gap)):
            dx, dy, dz = x[j] - x[last], y[j] - y[last], z[j] - z[last]
            gap[j] = min(gap[j], dx * dx + dy * dy + dz * dz)
        farthest = np.int32(-1)
        for j in range(len(gap)):
            farthest = max(farthest, bits[j])
        last = 0
        while bits[last] != farthest:
            last += 1
        taken[i] = last
    return taken

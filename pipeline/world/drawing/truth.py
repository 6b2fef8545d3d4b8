"""Depth, body and normal of every pixel, from triangles and poses, without a renderer's
rounding."""

from collections.abc import Mapping

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.data.cameras import Camera, Surfaces, extrinsics_cv, intrinsics, world_poses
from pipeline.poses import IDENTITY, matrix

from .engine import NEAR
from .silhouettes import Floats, Occluders, draw


def surfaces_of(solids: Occluders, poses: Mapping[str, Floats], camera: Camera) -> Surfaces:
    """The surfaces at pixel centres; `poses` (T,7) by body."""
    frames, kind = len(next(iter(poses.values()))), camera.type
    k, at = intrinsics(kind), world_poses(camera, poses, frames)
    view = np.broadcast_to(np.eye(4), (frames, 4, 4)).copy()
    view[:, :3] = extrinsics_cv(at)
    still = np.repeat(IDENTITY[None], frames, 0)
    placed = np.stack([poses.get(name, still) for name in solids.names], axis=1)
    matrices = np.ascontiguousarray((view[:, None] @ matrix(placed))[:, :, :3])
    shape = (frames, kind.height, kind.width)
    found = Surfaces(
        camera,
        at,
        np.zeros(shape, np.float32),
        np.zeros(shape, np.uint8),
        np.zeros((*shape, 3), np.float16),
    )
    labels = np.append(np.arange(1, len(solids.names)), 0).astype(np.uint8)
    lens = (k[0, 0], k[0, 2], k[1, 2], NEAR)
    normals = np.empty((*shape[1:], 3), np.float32)
    for t in range(frames):
        _look(
            (solids.vertices, solids.owner, solids.triangles),
            matrices[t],
            lens,
            labels,
            (found.depth[t], found.segmentation[t], normals),
        )
        found.normals[t] = normals
    return found


@njit(cache=True, error_model="numpy")
def _look(
    solids: tuple[Floats, NDArray[np.int64], NDArray[np.int64]],
    matrices: Floats,
    lens: tuple[float, float, float, float],
    labels: NDArray[np.uint8],
    out: tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]],
) -> None:
    """Depth, body and normal of each pixel into `out`."""
    vertices, owner, triangles = solids
    depth, body, normals = out
    f, cx, cy, near = lens
    seen, flat = np.empty((len(vertices), 3)), np.empty((len(vertices), 2))
    for v in range(len(vertices)):
        m, p = matrices[owner[v]], vertices[v]
        for i in range(3):
            seen[v, i] = m[i, 0] * p[0] + m[i, 1] * p[1] + m[i, 2] * p[2] + m[i, 3]
        z = seen[v, 2]
        if z >= near:
            flat[v, 0], flat[v, 1] = f * seen[v, 0] / z + cx, f * seen[v, 1] / z + cy
    depths, drawn = np.full(depth.shape, np.inf), np.empty(depth.shape, np.int64)
    draw(seen, flat, triangles, lens, (0, 0, 1), depths, drawn)
    for y in range(depth.shape[0]):
        for x in range(depth.shape[1]):
            if depths[y, x] == np.inf:
                depth[y, x], body[y, x], normals[y, x] = 0, 0, 0
                continue
            a, b, c = triangles[drawn[y, x]]
            normal = np.cross(seen[b] - seen[a], seen[c] - seen[a])
            depth[y, x], body[y, x] = depths[y, x], labels[owner[a]]
            normals[y, x] = normal / np.sqrt((normal * normal).sum())

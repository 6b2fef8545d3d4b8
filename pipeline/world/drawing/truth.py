"""Depth, body and normal of every pixel, from triangles and poses, without a renderer's
rounding."""

from collections.abc import Mapping

import numpy as np

from pipeline.data.cameras import Camera, Surfaces, intrinsics, world_poses
from pipeline.poses import Floats, Floats32, Pixels

from .compiled import compiled
from .engine import NEAR
from .silhouettes import Lens, Occluders, Triangles, draw, in_camera, project


def surfaces_of(solids: Occluders, poses: Mapping[str, Floats], camera: Camera) -> Surfaces:
    """The surfaces at pixel centres; `poses` (T,7) by body."""
    frames, kind = len(next(iter(poses.values()))), camera.type
    k, at = intrinsics(kind), world_poses(camera, poses, frames)
    _, matrices = in_camera(solids, poses, at)
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


@compiled
def _look(
    solids: Triangles,
    matrices: Floats,
    lens: Lens,
    labels: Pixels,
    out: tuple[Floats32, Pixels, Floats32],
) -> None:
    """Depth, body and normal of each pixel into `out`."""
    vertices, owner, triangles = solids
    depth, body, normals = out
    seen, flat = np.empty((len(vertices), 3)), np.empty((len(vertices), 2))
    project(solids, matrices, lens, seen, flat)
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

"""How much of a body a camera sees, without drawing: a depth buffer of its triangles and all
occluders, covered like a renderer's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.data.cameras import CameraType, extrinsics_cv, intrinsics
from pipeline.poses import (
    IDENTITY,
    Floats,
    Floats32,
    Ints,
    compose,
    inverse,
    matrix,
    pose,
    quat_from_matrix,
)
from pipeline.world.shapes import Parts

from .compiled import compiled
from .engine import NEAR
from .software.raster import solids_of

type Triangles = tuple[Floats, Ints, Ints]
"""Vertices, owner and triangles of `Occluders`."""

type Lens = tuple[float, float, float, float]
"""Focal length and middle of the image (pixels), and the near plane (m)."""

SAMPLES = 2048
"""Most pixels of a silhouette's box that are looked at, on an even grid; exact below it."""

FIXED = "what stands still"  # no name of a body: those have no spaces
_OPTICAL = pose((0, 0, 0), quat_from_matrix([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
"""A camera's pose with z forward, in the one with x forward."""


@dataclass(frozen=True, eq=False)
class Occluders:
    """Triangles of B bodies: vertices (V,3) in the frame of `owner` (V,), triangles (M,3), and
    ranges (B,2)."""

    names: tuple[str, ...]
    vertices: Floats
    owner: Ints
    triangles: Ints
    spans: Ints
    corners: Ints


def occluders_of(bodies: Mapping[str, Parts], fixed: Parts) -> Occluders:
    """All occluders; `fixed` is in the world frame."""
    every = (*bodies.values(), fixed)
    solids = solids_of([mesh for parts in every for mesh, _ in parts])
    ends = np.cumsum([0, *map(len, every)])
    points, faces = (np.append(0, solids.spans[:, k])[ends] for k in (1, 3))
    return Occluders(
        (*bodies, FIXED),
        solids.points.astype(float),
        np.repeat(np.arange(len(every)), np.diff(points)),
        solids.corners.astype(np.int64),
        np.stack([faces[:-1], faces[1:]], 1),
        np.stack([points[:-1], points[1:]], 1),
    )


def in_camera(
    solids: Occluders, poses: Mapping[str, Floats], camera_poses: Floats
) -> tuple[Floats, Floats]:
    """World poses (T,B,7) of all bodies, and what takes each into the camera's frame (T,B,3,4)."""
    view = np.broadcast_to(np.eye(4), (len(camera_poses), 4, 4)).copy()
    view[:, :3] = extrinsics_cv(camera_poses)
    still = np.repeat(IDENTITY[None], len(camera_poses), 0)
    placed = np.stack([poses.get(name, still) for name in solids.names], axis=1)
    return placed, np.ascontiguousarray((view[:, None] @ matrix(placed))[:, :, :3])


@dataclass(frozen=True, eq=False)
class BodyTracks:
    """N bodies in T images. `box` (T,N,4) is left, top, right, bottom (pixels) of the whole
    silhouette, `centre` (T,N,2) the bounding box's middle; zeros behind the camera. `visible` (T,N)
    is the share in the image and not occluded, of the silhouette up to one image beyond each
    border. `pose` (T,N,7) is in the camera frame, x right, y down, z forward."""

    box: Floats32
    centre: Floats32
    visible: Floats32
    pose: Floats


def track_bodies(
    solids: Occluders,
    poses: Mapping[str, Floats],
    names: Sequence[str],
    kind: CameraType,
    camera_poses: Floats,
) -> BodyTracks:
    """Tracks of the bodies `names`; world poses (T,7)."""
    placed, matrices = in_camera(solids, poses, camera_poses)
    index = np.array([solids.names.index(name) for name in names], np.int64)
    k = intrinsics(kind)
    lens, size = (k[0, 0], k[0, 2], k[1, 2], NEAR), (kind.width, kind.height)
    triangles = solids.vertices, solids.owner, solids.triangles
    boxes, counts = _track(triangles, solids.spans, matrices, index, lens, size)
    whole, seen = counts[..., 0], counts[..., 1]
    inside = [solids.vertices[first:end] for first, end in solids.corners[index]]
    middles = np.array([(v.min(0) + v.max(0)) / 2 if len(v) else np.zeros(3) for v in inside])
    chosen = matrices[:, index]
    at = np.einsum("tnij,nj->tni", chosen[..., :3], middles) + chosen[..., 3]
    front = (at[..., 2:] > NEAR) & (whole > 0)[..., None]
    centre = np.where(front, (at @ k.T)[..., :2] / np.where(front, at[..., 2:], 1.0), 0.0)
    body_poses = compose(inverse(compose(camera_poses, _OPTICAL))[:, None], placed[:, index])
    return BodyTracks(
        boxes.astype(np.float32),
        centre.astype(np.float32),
        (seen / np.maximum(whole, 1)).astype(np.float32),
        body_poses,
    )


@compiled
def _track(
    solids: Triangles, spans: Ints, matrices: Floats, index: Ints, lens: Lens, size: tuple[int, int]
) -> tuple[Floats, Ints]:
    """Boxes (T,N,4) and sampled pixels (T,N,2) of whole and visible silhouettes, in images of a
    width and height."""
    vertices, owner, triangles = solids
    frames, count, near = len(matrices), len(index), lens[3]
    width, height = size
    boxes, pixels = np.zeros((frames, count, 4)), np.zeros((frames, count, 2), np.int64)
    seen, flat = np.empty((len(vertices), 3)), np.empty((len(vertices), 2))
    # of every body: left, top, right, bottom, nearest and farthest
    reach = np.empty((len(spans), 6))
    for t in range(frames):
        project(solids, matrices[t], lens, seen, flat)
        reach[:, 0], reach[:, 1], reach[:, 4] = np.inf, np.inf, np.inf
        reach[:, 2], reach[:, 3], reach[:, 5] = -np.inf, -np.inf, -np.inf
        for v in range(len(vertices)):
            (x, y), z, r = flat[v], seen[v, 2], reach[owner[v]]
            r[4], r[5] = min(r[4], z), max(r[5], z)
            if z >= near:
                r[0], r[1], r[2], r[3] = min(r[0], x), min(r[1], y), max(r[2], x), max(r[3], y)
        for n in range(count):
            first, end = spans[index[n]]
            box = _box(seen, flat, triangles[first:end], lens)
            if box[0] > box[2]:
                continue
            for i in range(4):  # an assignment of all takes 2 s more to compile
                boxes[t, n, i] = box[i]
            # a silhouette is followed for one image beyond each border
            x0, y0 = int(np.floor(max(box[0], -width))), int(np.floor(max(box[1], -height)))
            w = int(np.ceil(min(box[2], 2 * width))) - x0
            h = int(np.ceil(min(box[3], 2 * height))) - y0
            if w <= 0 or h <= 0:
                continue
            grid = max(1, int(np.ceil(np.sqrt(w * h / SAMPLES))))
            shape = (-(-h // grid), -(-w // grid))
            own, other, place = np.full(shape, np.inf), np.full(shape, np.inf), (x0, y0, grid)
            drawn = np.empty(shape, np.int64)
            draw(seen, flat, triangles[first:end], lens, place, own, drawn)
            for b in range(len(spans)):
                r = reach[b]
                apart = r[0] > box[2] or r[2] < box[0] or r[1] > box[3] or r[3] < box[1]
                # a body that reaches through the near plane is seen wider than its corners
                hidden = r[5] < near or r[4] > reach[index[n], 5] or (apart and r[4] >= near)
                if b == index[n] or hidden:
                    continue
                first, end = spans[b]
                draw(seen, flat, triangles[first:end], lens, place, other, drawn)
            for row in range(shape[0]):
                for column in range(shape[1]):
                    if own[row, column] < np.inf:
                        x, y = x0 + grid * column + grid // 2, y0 + grid * row + grid // 2
                        pixels[t, n, 0] += 1
                        inside = 0 <= x < width and 0 <= y < height
                        pixels[t, n, 1] += inside and own[row, column] <= other[row, column]
    return boxes, pixels


@compiled
def project(solids: Triangles, matrices: Floats, lens: Lens, seen: Floats, flat: Floats) -> None:
    """Vertices in the camera's frame into `seen` (V,3); pixels of those beyond the near plane into
    `flat` (V,2)."""
    vertices, owner, _ = solids
    f, cx, cy, near = lens
    for v in range(len(vertices)):
        m, p = matrices[owner[v]], vertices[v]
        for i in range(3):
            seen[v, i] = m[i, 0] * p[0] + m[i, 1] * p[1] + m[i, 2] * p[2] + m[i, 3]
        z = seen[v, 2]
        if z >= near:
            flat[v, 0], flat[v, 1] = f * seen[v, 0] / z + cx, f * seen[v, 1] / z + cy


@compiled
def _cut(seen: Floats, flat: Floats, triangle: Ints, lens: Lens, out: Floats) -> int:
    """How many corners a triangle has beyond the near plane; their pixels and depths into `out`
    (4,3)."""
    f, cx, cy, near = lens
    size = 0
    for i in range(3):
        a, b = triangle[i], triangle[(i + 1) % 3]
        if seen[a, 2] >= near:
            out[size, 0], out[size, 1], out[size, 2] = flat[a, 0], flat[a, 1], seen[a, 2]
            size += 1
        if (seen[a, 2] >= near) != (seen[b, 2] >= near):
            share = (near - seen[a, 2]) / (seen[b, 2] - seen[a, 2])
            out[size, 0] = f * (seen[a, 0] + share * (seen[b, 0] - seen[a, 0])) / near + cx
            out[size, 1] = f * (seen[a, 1] + share * (seen[b, 1] - seen[a, 1])) / near + cy
            out[size, 2] = near
            size += 1
    return size


@compiled
def _box(
    seen: Floats, flat: Floats, triangles: Ints, lens: Lens
) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of triangles beyond the near plane; left > right: none."""
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    corners = np.empty((4, 3))
    for k in range(len(triangles)):
        for i in range(_cut(seen, flat, triangles[k], lens, corners)):
            x, y = corners[i, 0], corners[i, 1]
            left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
    return left, top, right, bottom


@compiled
def draw(
    seen: Floats,
    flat: Floats,
    triangles: Ints,
    lens: Lens,
    place: tuple[int, int, int],
    depths: Floats,
    drawn: Ints,
) -> None:
    """Draw triangles into depths (h,w), the nearest's row into `drawn` (h,w). An entry is the
    middle of `grid` by `grid` pixels; `place` is x0, y0, grid."""
    x0, y0, grid = place
    # the centre of the pixel in the middle of a grid cell lies on whole numbers
    shift = grid // 2 + 0.5
    corners = np.empty((4, 3))
    for k in range(len(triangles)):
        size = _cut(seen, flat, triangles[k], lens, corners)
        for i in range(size):
            corners[i, 0] = (corners[i, 0] - x0 - shift) / grid
            corners[i, 1] = (corners[i, 1] - y0 - shift) / grid
        for i in range(1, size - 1):
            _fill(corners, (0, i, i + 1), k, depths, drawn)


@compiled
def _fill(
    corners: Floats, chosen: tuple[int, int, int], number: int, depths: Floats, drawn: Ints
) -> None:
    """Draw one triangle by corners (3,) of column, row and depth, unless it turns its back."""
    a, b, c = corners[chosen[0]], corners[chosen[1]], corners[chosen[2]]
    rows, columns = depths.shape
    left = max(0, int(np.ceil(max(-1.0, min(a[0], b[0], c[0])))))
    right = int(np.floor(min(columns - 1.0, max(a[0], b[0], c[0]))))
    top = max(0, int(np.ceil(max(-1.0, min(a[1], b[1], c[1])))))
    bottom = int(np.floor(min(rows - 1.0, max(a[1], b[1], c[1]))))
    if left > right or top > bottom:
        return
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area >= 0:  # seen from its back
        return
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            wa = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
            wb = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
            wc = 1 - wa - wb
            if wa >= 0 and wb >= 0 and wc >= 0:
                # what is linear in the image is the reciprocal of the depth
                depth = 1 / (wa / a[2] + wb / b[2] + wc / c[2])
                if depth < depths[y, x]:
                    depths[y, x], drawn[y, x] = depth, number

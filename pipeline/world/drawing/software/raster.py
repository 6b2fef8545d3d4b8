"""Which triangle each pixel shows: bodies as triangles, the room as parallelograms."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Bools, Floats, Floats32, Ints
from pipeline.world.shapes import Mesh

from .kernels import kernel

Ids = NDArray[np.int32]

NOTHING = -1
"""Pixels without a surface; triangle t has the number t, and quad k has -2 - k."""
NARROW = 4  # pixels; rows of wider triangles are entered and left where their edges cross them


class Frame(NamedTuple):
    """What each of the H * W pixels shows: 1 / distance along the view axis, the surface, and of
    triangles two barycentric coordinates over the distance. `seen` (N,5) are points of bodies in
    the camera's frame, and their pixels."""

    inverse: Floats32
    ids: Ids
    first: Floats32
    second: Floats32
    seen: Floats32


class Lens(NamedTuple):
    """Image size and focal length (pixels), nearest and farthest distance (m)."""

    width: int
    height: int
    focal: float
    near: float
    far: float


@kernel
def rotation(pose: Floats) -> Floats:
    """Matrix (3,3) of a pose (7,)."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    n = 2 / (w * w + x * x + y * y + z * z)
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = (
        1 - n * (y * y + z * z),
        n * (x * y - w * z),
        n * (x * z + w * y),
    )
    out[1, 0], out[1, 1], out[1, 2] = (
        n * (x * y + w * z),
        1 - n * (x * x + z * z),
        n * (y * z - w * x),
    )
    out[2, 0], out[2, 1], out[2, 2] = (
        n * (x * z - w * y),
        n * (y * z + w * x),
        1 - n * (x * x + y * y),
    )
    return out


@kernel
def joined(turn: Floats, at: Floats, pose: Floats) -> Floats32:
    """What takes points of a body in this world pose through a rotation (3,3) and then by `at`
    (3,), as (3,4)."""
    own, out = rotation(pose), np.empty((3, 4), np.float32)
    for i in range(3):
        for j in range(3):
            out[i, j] = turn[i, 0] * own[0, j] + turn[i, 1] * own[1, j] + turn[i, 2] * own[2, j]
        out[i, 3] = turn[i, 0] * pose[0] + turn[i, 1] * pose[1] + turn[i, 2] * pose[2] + at[i]
    return out


@kernel
def turned(normals: Floats32, span: Ints, pose: Floats, out: Floats32) -> None:
    """Normals (N,3) of a body's points in the world, into the first columns of `out`."""
    m = rotation(pose).astype(np.float32)
    for i in range(span[0], span[1]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        out[i, 0] = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z
        out[i, 1] = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z
        out[i, 2] = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z


@kernel
def _project(points: Floats32, span: Ints, move: Floats32, lens: Lens, out: Floats32) -> None:
    """Points of `span` moved by (3,4) into the camera's frame, and their pixels: `out` (N,5)."""
    focal, near = np.float32(lens.focal), np.float32(lens.near)
    cx, cy = np.float32(lens.width / 2), np.float32(lens.height / 2)
    for i in range(span[0], span[1]):
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = move[0, 0] * a + move[0, 1] * b + move[0, 2] * c + move[0, 3]
        y = move[1, 0] * a + move[1, 1] * b + move[1, 2] * c + move[1, 3]
        z = move[2, 0] * a + move[2, 1] * b + move[2, 2] * c + move[2, 3]
        out[i, 0], out[i, 1], out[i, 2] = x, y, z
        scale = focal / max(z, near)
        out[i, 3], out[i, 4] = x * scale + cx, y * scale + cy


class Solids(NamedTuple):
    """Bodies: points (N,3) and corners (M,3) of all, and of each (B,4) its first and last point
    and triangle."""

    points: Floats32
    corners: Ids
    spans: Ints


def solids_of(meshes: Sequence[Mesh]) -> Solids:
    """Each mesh is a body."""
    points, faces = (
        np.cumsum([0, *(len(array) for array in arrays)])
        for arrays in ([m.vertices for m in meshes], [m.triangles for m in meshes])
    )
    none = np.zeros((0, 3))
    corners = [mesh.triangles.astype(np.int32) + k for mesh, k in zip(meshes, points, strict=False)]
    return Solids(
        np.concatenate([none, *(mesh.vertices for mesh in meshes)]).astype(np.float32),
        np.concatenate([none, *corners]).astype(np.int32),
        np.stack([points[:-1], points[1:], faces[:-1], faces[1:]], 1),
    )


@kernel
def fill_bodies(
    solids: Solids, shown: Ints, poses: Floats, view: Floats, lens: Lens, frame: Frame
) -> None:
    """Draw the bodies that are shown from their world poses (B,7). `view` (3,4) takes the world to
    the camera's frame: x right, y down, z forward."""
    turn, at = view[:, :3].copy(), view[:, 3].copy()
    for k in shown:
        span = solids.spans[k]
        _project(solids.points, span, joined(turn, at, poses[k]), lens, frame.seen)
        _fill_triangles(solids.corners, (span[2], span[3]), frame.seen, lens, frame)


@kernel
def _fill_triangles(
    corners: Ids, span: tuple[int, int], seen: Floats32, lens: Lens, frame: Frame
) -> None:
    """Draw the triangles of `span` that face the camera."""
    near = np.float32(lens.near)
    for t in range(span[0], span[1]):
        i, j, k = corners[t, 0], corners[t, 1], corners[t, 2]
        x0, y0, x1, y1 = seen[i, 3], seen[i, 4], seen[j, 3], seen[j, 4]
        x2, y2 = seen[k, 3], seen[k, 4]
        front = (seen[i, 2] >= near) + (seen[j, 2] >= near) + (seen[k, 2] >= near)
        if front == 0:
            continue
        box = 0, lens.width - 1, 0, lens.height - 1
        if front == 3:
            if (x1 - x0) * (y2 - y0) >= (x2 - x0) * (y1 - y0):
                continue
            half = np.float32(0.5)
            box = (
                max(int(np.ceil(min(x0, x1, x2) - half)), 0),
                min(int(np.floor(max(x0, x1, x2) - half)), lens.width - 1),
                max(int(np.ceil(min(y0, y1, y2) - half)), 0),
                min(int(np.floor(max(y0, y1, y2) - half)), lens.height - 1),
            )
            if box[0] > box[1] or box[2] > box[3]:
                continue
        a = (np.float64(seen[i, 0]), np.float64(seen[i, 1]), np.float64(seen[i, 2]))
        b = (np.float64(seen[j, 0]), np.float64(seen[j, 1]), np.float64(seen[j, 2]))
        c = (np.float64(seen[k, 0]), np.float64(seen[k, 1]), np.float64(seen[k, 2]))
        _fill((a, b, c), t, box, lens, frame)


@kernel
def _planes(
    a: tuple[float, float, float], b: tuple[float, float, float], c: tuple[float, float, float]
) -> tuple[float, ...]:
    """Six times the volume over three corners, and the cross products of b, c and of c, a and of
    all: those of two corners are 0 on the edge between them."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = a, b, c
    m0x, m0y, m0z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    m1x, m1y, m1z = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    m2x, m2y, m2z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    volume = ax * m0x + ay * m0y + az * m0z
    whole = m0x + m1x + m2x, m0y + m1y + m2y, m0z + m1z + m2z
    return volume, m1x, m1y, m1z, m2x, m2y, m2z, *whole


@kernel
def _fill(
    corners: tuple[tuple[float, float, float], ...],
    number: int,
    box: tuple[int, int, int, int],
    lens: Lens,
    frame: Frame,
) -> None:
    """Draw one triangle: for the ray (x, y, 1) of a pixel, 1 / distance q and both coordinates
    over the distance are linear in x and y."""
    a, b, c = corners
    volume, m1x, m1y, m1z, m2x, m2y, m2z, mqx, mqy, mqz = _planes(a, b, c)
    if volume >= 0:  # seen from behind
        return
    by_volume, pixel = 1 / volume, 1 / lens.focal
    scale = by_volume * pixel
    step_u, step_v, step_q = m1x * scale, m2x * scale, mqx * scale
    nearest, inverses, ids = 1 / lens.near, frame.inverse, frame.ids
    dx = (box[0] + 0.5 - lens.width / 2) * pixel
    for y in range(box[2], box[3] + 1):
        dy = (y + 0.5 - lens.height / 2) * pixel
        u = (m1x * dx + m1y * dy + m1z) * by_volume
        v = (m2x * dx + m2y * dy + m2z) * by_volume
        q = (mqx * dx + mqy * dy + mqz) * by_volume
        low, high = 0, box[1] - box[0]
        if high > NARROW:
            low, high = _cut(u, step_u, low, high, 1)
            low, high = _cut(v, step_v, low, high, 1)
            low, high = _cut(q - u - v, step_q - step_u - step_v, low, high, 1)
        p = y * lens.width + box[0]
        for x in range(low, high + 1):
            here_q, here_u, here_v = q + step_q * x, u + step_u * x, v + step_v * x
            if here_u >= 0 and here_v >= 0 and here_q >= here_u + here_v:
                inverse, at = np.float32(here_q), np.uint64(p + x)
                if inverse > inverses[at] and here_q <= nearest:
                    inverses[at], ids[at] = inverse, number
                    frame.first[at], frame.second[at] = here_u, here_v


@kernel
def fill_quads(quads: Floats, walls: Bools, lens: Lens, frame: Frame) -> None:
    """Draw parallelograms by their corners a, a + u, a + v in the camera's frame (Q,3,3). Walls
    reach a pixel farther: another wall is nearer there, so that no seam stays open."""
    pixel, x0, y0 = 1 / lens.focal, lens.width / 2 - 0.5, lens.height / 2 - 0.5
    for k in range(len(quads)):
        a = quads[k, 0, 0], quads[k, 0, 1], quads[k, 0, 2]
        b = quads[k, 1, 0], quads[k, 1, 1], quads[k, 1, 2]
        c = quads[k, 2, 0], quads[k, 2, 1], quads[k, 2, 2]
        volume, m1x, m1y, m1z, m2x, m2y, m2z, mqx, mqy, mqz = _planes(a, b, c)
        if volume >= 0:
            continue
        by_volume, margin = 1 / volume, 1 if walls[k] else 0
        scale = by_volume * pixel
        step_u, step_v, step_q = m1x * scale, m2x * scale, mqx * scale
        for y in range(lens.height):
            dx, dy = -x0 * pixel, (y - y0) * pixel
            u = (m1x * dx + m1y * dy + m1z) * by_volume
            v = (m2x * dx + m2y * dy + m2z) * by_volume
            q = (mqx * dx + mqy * dy + mqz) * by_volume
            low, high = _cut(u, step_u, 0, lens.width - 1, margin)
            low, high = _cut(v, step_v, low, high, margin)
            low, high = _cut(q - u, step_q - step_u, low, high, margin)
            low, high = _cut(q - v, step_q - step_v, low, high, margin)
            low, high = _cut(q - 1 / lens.far, step_q, low, high, 0)
            low, high = _cut(1 / lens.near - q, -step_q, low, high, 0)
            if low <= high:
                start, end = y * lens.width + low, y * lens.width + high + 1
                _line(
                    np.float32(q + step_q * low),
                    np.float32(step_q),
                    np.int32(-2 - k),
                    frame.inverse[start:end],
                    frame.ids[start:end],
                )


@kernel
def _line(q, step, number, inverses, ids) -> None:
    for x in range(len(inverses)):
        here = q + step * np.float32(x)
        nearer = here > inverses[x]
        inverses[x] = here if nearer else inverses[x]
        ids[x] = number if nearer else ids[x]


@kernel
def _cut(at: float, step: float, low: int, high: int, margin: int) -> tuple[int, int]:
    """The part of low..high in which at + step * x is 0 or more, and a margin."""
    if step > 1e-12:
        return max(low, int(np.ceil(min(max(-at / step, -1e6), 1e6))) - margin), high
    if step < -1e-12:
        return low, min(high, int(np.floor(min(max(at / -step, -1e6), 1e6))) + margin)
    return (low, high) if at >= 0 else (low, low - 1)

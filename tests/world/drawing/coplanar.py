"""Where two differently coloured parts show the same plane: a renderer draws now the one, now the
other."""

from collections.abc import Sequence
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipeline.world.shapes import Material, Parts

Floats = NDArray[np.float64]

APART = 5e-5
"""Faces nearer than this (m) are in one plane; a 24-bit depth buffer from 1 cm on resolves it up to
2 m away."""

LEVEL = 1e-3
"""Angle (rad) within which two faces count as parallel."""

AREA = 1e-6
"""Common area (m2) of two parts that counts: one square millimetre, half a pixel of a wrist
camera."""


def coplanar(parts: Sequence[tuple[str, Parts]]) -> dict[tuple[str, str], float]:
    """Common area (m2) by pair of "name/number of part" of faces of bodies, given in one frame,
    that show the same plane.

    Only faces that look the same way count, since a face that is seen from behind is not drawn, and
    only where no other part covers them. Faces of one material may share a plane: nobody sees which
    is drawn.
    """
    named = [
        (f"{name}/{i}", mesh, material)
        for name, own in parts
        for i, (mesh, material) in enumerate(own)
    ]
    corners = [mesh.vertices[mesh.triangles].astype(float) for _, mesh, _ in named]
    everything, part = (
        np.concatenate(corners),
        np.repeat(np.arange(len(named)), [len(c) for c in corners]),
    )
    twice = np.cross(everything[:, 1] - everything[:, 0], everything[:, 2] - everything[:, 0])
    size = np.linalg.norm(twice, axis=1)
    real = size > 1e-12
    everything, part, normal = everything[real], part[real], twice[real] / size[real, None]
    looks = [_look(material) for _, _, material in named]
    pairs = _in_one_plane(everything, normal)
    pairs = (
        pairs[[looks[part[a]] != looks[part[b]] for a, b in pairs.tolist()]]
        if len(pairs)
        else pairs
    )
    found = dict[tuple[str, str], float]()
    order = sorted(pairs.tolist(), key=lambda pair: (part[pair[0]], part[pair[1]]))
    for (one, other), both in groupby(
        order, key=lambda pair: (int(part[pair[0]]), int(part[pair[1]]))
    ):
        common = [(_common(everything[a], everything[b], normal[a]), normal[a]) for a, b in both]
        seen = [(area, point + 2e-4 * n) for (area, point), n in common if area > 1e-9]
        if not seen:
            continue
        areas, points = np.array([area for area, _ in seen]), np.array([point for _, point in seen])
        total = float(areas[~_inside(points, everything)].sum())
        if total > AREA:
            found[named[one][0], named[other][0]] = total
    return found


def _look(material: Material) -> tuple[object, ...]:
    return (
        material.color,
        material.roughness,
        material.metallic,
        material.source,
        id(material.texture),
    )


def _in_one_plane(corners: Floats, normal: Floats) -> NDArray[np.intp]:
    """Pairs (P,2) of triangles (N,3,3) that are parallel, look the same way, lie in one plane, and
    whose bounds overlap."""
    pairs = cKDTree(normal).query_pairs(LEVEL, output_type="ndarray")
    a, b = pairs.T
    near = np.ones(len(pairs), bool)
    for k in range(3):
        near &= np.abs(np.einsum("ij,ij->i", normal[a], corners[b, k] - corners[a, 0])) < APART
    lower, upper = corners.min(1), corners.max(1)
    near &= ((lower[a] < upper[b] + APART) & (lower[b] < upper[a] + APART)).all(1)
    return pairs[near]


def _common(one: Floats, other: Floats, normal: Floats) -> tuple[float, Floats]:
    """Area (m2) and centre (3,) of what two triangles (3,3) in a plane share (Sutherland and
    Hodgman)."""
    polygon = list(other)
    for k in range(3):
        inwards = np.cross(normal, one[(k + 1) % 3] - one[k])
        depth = [float(inwards @ (p - one[k])) for p in polygon]
        clipped = list[Floats]()
        for i, p in enumerate(polygon):
            j = (i + 1) % len(polygon)
            if depth[i] >= 0:
                clipped.append(p)
            if (depth[i] >= 0) != (depth[j] >= 0):
                clipped.append(p + depth[i] / (depth[i] - depth[j]) * (polygon[j] - p))
        polygon = clipped
        if len(polygon) < 3:
            return 0.0, one[0]
    fan = [
        0.5 * np.linalg.norm(np.cross(p - polygon[0], q - polygon[0]))
        for p, q in pairwise(polygon[1:])
    ]
    return float(sum(fan)), np.mean(polygon, axis=0)


def _inside(points: Floats, corners: Floats) -> NDArray[np.bool_]:
    """Which points (P,3) lie inside of closed surfaces of triangles (N,3,3): the winding number by
    solid angles."""
    out = np.zeros(len(points), bool)
    for i, point in enumerate(points):
        a, b, c = (corners[:, k] - point for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        under = la * lb * lc + sum(
            x * (y * z).sum(1) for x, y, z in ((la, b, c), (lb, a, c), (lc, a, b))
        )
        out[i] = np.arctan2(volume, under).sum() / (2 * np.pi) > 0.5
    return out

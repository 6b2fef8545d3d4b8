"""Convex collision pieces (m, body frame, z up); hollow things are hollow."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, pose, quat_about, quat_from_matrix, quat_multiply
from pipeline.world.shapes import Collider

Colliders = tuple[Collider, ...]
UPRIGHT = (1.0, 0.0, 0.0, 0.0)

ALONG_X = quat_about((0, 1, 0), np.pi / 2)
ALONG_Y = quat_about((1, 0, 0), -np.pi / 2)


def box_collider(
    hx: float, hy: float, hz: float, position: ArrayLike, quaternion: ArrayLike = UPRIGHT
) -> Colliders:
    return (Collider("box", (hx, hy, hz), pose(position, quaternion)),)


def cylinder_collider(
    radius: float,
    lower: float,
    upper: float,
    centre: ArrayLike = (0, 0),
    quaternion: ArrayLike = UPRIGHT,
) -> Colliders:
    """A cylinder between two heights at `centre` (x, y)."""
    x, y = np.asarray(centre, float)
    at = pose((x, y, (lower + upper) / 2), quaternion)
    return (Collider("cylinder", (radius, (upper - lower) / 2), at),)


def push_button(radius: float, lower: float, upper: float) -> Colliders:
    """Two crossed boxes: on a small cylinder's rim PhysX may find a box millimetres deep, and
    throws both apart."""
    side, half, middle = 0.75 * radius, (upper - lower) / 2, (lower + upper) / 2
    turns = (quat_about((0, 0, 1), angle) for angle in (0.0, np.pi / 4))
    return tuple(Collider("box", (side, side, half), pose((0, 0, middle), turn)) for turn in turns)


def slab(hx: float, hy: float, height: float) -> Colliders:
    return box_collider(hx, hy, height / 2, (0, 0, height / 2))


def disc(radius: float, thickness: float, z: float = 0.0) -> Colliders:
    return cylinder_collider(radius, z, z + thickness)


def sphere_collider(radius: float, position: ArrayLike = (0, 0, 0)) -> Colliders:
    return (Collider("sphere", (radius,), pose(position)),)


def capsule_between(a: ArrayLike, b: ArrayLike, radius: float) -> Colliders:
    a, b = np.asarray(a, float), np.asarray(b, float)
    half = float(np.linalg.norm(b - a)) / 2
    return (Collider("capsule", (radius, half), pose((a + b) / 2, _along(b - a))),)


def arc_of_capsules(path: ArrayLike, radius: float) -> Colliders:
    path = np.asarray(path, float)
    return tuple(c for a, b in pairwise(path) for c in capsule_between(a, b, radius))


def convex_collider(points: ArrayLike) -> Colliders:
    return (Collider("convex", (), vertices=np.asarray(points, float)),)


def twelve_sided(outline: Sequence[tuple[float, float]]) -> list[tuple[float, float, float]]:
    """Twelve points (m) round z for each (radius, z) of `outline`, for hulls of round bodies."""
    turns = np.arange(12) * np.pi / 6
    return [(r * np.cos(a), r * np.sin(a), z) for r, z in outline for a in turns]


def prism_collider(outline: Floats, half: float) -> Colliders:
    """Hull of a prism over (x, z) (K,2), between y = -`half` and `half`."""
    sides = [np.insert(outline, 1, y, axis=1) for y in (-half, half)]
    return convex_collider(np.concatenate(sides))


def ring_of_boxes(
    radius: float, wall: float, height: float, n: int = 16, z: float = 0.0, top: float | None = None
) -> Colliders:
    """A hollow wall of `n` boxes of outer `radius` from `z` up; outer faces touch the circle
    half-way between inscribed and circumscribed polygons."""
    top = radius if top is None else top
    middle, slant = (radius + top) / 2, np.hypot(height, top - radius)
    fit = (1 + np.cos(np.pi / n)) / 2
    lean = quat_about((0, 1, 0), float(np.arctan2(top - radius, height)))
    half_width = max(radius, top) * np.tan(np.pi / n)
    pieces = []
    for k in range(n):
        angle = 2 * np.pi * (k + 0.5) / n
        turn = quat_multiply(quat_about((0, 0, 1), angle), lean)
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        normal = np.array([np.cos(angle) * height, np.sin(angle) * height, radius - top]) / slant
        centre = out * middle * fit + [0, 0, z + height / 2] - normal * wall / 2
        pieces.append(Collider("box", (wall / 2, half_width, slant / 2), pose(centre, turn)))
    return tuple(pieces)


def vessel(foot: float, wall: float, height: float, n: int, rim: float | None = None) -> Colliders:
    return disc(foot, wall) + ring_of_boxes(foot, wall, height, n, top=rim)


def tray(hx: float, hy: float, wall: float, height: float) -> Colliders:
    h, w = height / 2, wall / 2
    return (
        *slab(hx, hy, wall),
        *(c for x in (hx - w, w - hx) for c in box_collider(w, hy, h, (x, 0, h))),
        *(c for y in (hy - w, w - hy) for c in box_collider(hx, w, h, (0, y, h))),
    )


def _along(direction: np.ndarray) -> np.ndarray:
    z = direction / np.linalg.norm(direction)
    x = np.eye(3)[np.argmin(np.abs(z))]
    x = x - z * (x @ z)
    x /= np.linalg.norm(x)
    return quat_from_matrix(np.stack([x, np.cross(z, x), z], axis=1))

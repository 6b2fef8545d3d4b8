"""Where a straight line runs inside collision pieces: an independent check of grasps."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import ConvexHull

from pipeline.poses import inverse, matrix
from pipeline.world.shapes import Collider

Interval = tuple[float, float]
Line = Callable[[np.ndarray, np.ndarray], Interval | None]


def prepare(pieces: Sequence[Collider]) -> list[Line]:
    """For each piece a function of (origin, unit direction): the range of t for which origin + t *
    direction lies inside it."""
    return [_line(c) for c in pieces]


def _line(piece: Collider) -> Line:
    to_local = matrix(inverse(piece.pose))
    turn, shift = to_local[:3, :3], to_local[:3, 3]
    if piece.kind == "box":
        normals, offsets = np.vstack([np.eye(3), -np.eye(3)]), np.tile(piece.size, 2)
    elif piece.kind == "convex":
        hull = ConvexHull(piece.vertices).equations
        normals, offsets = hull[:, :3], -hull[:, 3]
    else:
        normals, offsets = np.array([[0, 0, 1.0], [0, 0, -1]]), np.full(2, piece.size[-1])
    flat = piece.kind in ("box", "convex")

    def inside(origin: np.ndarray, direction: np.ndarray) -> Interval | None:
        o, d = turn @ origin + shift, turn @ direction
        return _slabs(normals, offsets, o, d) if flat else _round(piece, normals, offsets, o, d)

    return inside


def _round(
    piece: Collider, normals: np.ndarray, offsets: np.ndarray, o: np.ndarray, d: np.ndarray
) -> Interval | None:
    r = piece.size[0]
    if piece.kind == "sphere":
        return _roots(d @ d, o @ d, o @ o - r**2)
    across = np.array([1.0, 1, 0])
    found = [
        _meet(
            _roots((d * across) @ d, (o * across) @ d, (o * across) @ o - r**2),
            _slabs(normals, offsets, o, d),
        )
    ]
    if piece.kind == "capsule":
        for c in (np.array([0, 0, -piece.size[1]]), np.array([0, 0, piece.size[1]])):
            found.append(_roots(d @ d, (o - c) @ d, (o - c) @ (o - c) - r**2))
    real = [f for f in found if f]
    return (min(f[0] for f in real), max(f[1] for f in real)) if real else None


def merged(intervals: Sequence[Interval], gap: float = 5e-4) -> list[Interval]:
    """Sorted union of intervals; ones closer than `gap` are one."""
    out: list[Interval] = []
    for lower, upper in sorted(intervals):
        if out and lower <= out[-1][1] + gap:
            out[-1] = (out[-1][0], max(out[-1][1], upper))
        else:
            out.append((lower, upper))
    return out


def _slabs(
    normals: np.ndarray, offsets: np.ndarray, o: np.ndarray, d: np.ndarray
) -> Interval | None:
    speed, room = normals @ d, offsets - normals @ o
    level = np.abs(speed) < 1e-12
    if np.any(room[level] < 0):
        return None
    t = room / np.where(level, 1.0, speed)
    lower = np.max(t[~level & (speed < 0)], initial=-np.inf)
    upper = np.min(t[~level & (speed > 0)], initial=np.inf)
    return (float(lower), float(upper)) if lower < upper else None


def _roots(a: float, half_b: float, c: float) -> Interval | None:
    if a < 1e-12:
        return (-np.inf, np.inf) if c < 0 else None
    root = half_b**2 - a * c
    return None if root <= 0 else ((-half_b - root**0.5) / a, (-half_b + root**0.5) / a)


def _meet(a: Interval | None, b: Interval | None) -> Interval | None:
    if a is None or b is None:
        return None
    lower, upper = max(a[0], b[0]), min(a[1], b[1])
    return (lower, upper) if lower < upper else None

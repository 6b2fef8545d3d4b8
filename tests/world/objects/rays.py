"""Where a straight line runs inside collision pieces: an independent check of grasps."""

import numpy as np
from scipy.spatial import ConvexHull

from pipeline.poses import inverse, quat_rotate, transform
from pipeline.world.shapes import Collider

Interval = tuple[float, float]


def inside(piece: Collider, origin: np.ndarray, direction: np.ndarray) -> Interval | None:
    """The range of t for which origin + t * direction (unit) lies inside the piece."""
    local = inverse(piece.pose)
    o, d = transform(local, origin), quat_rotate(local[3:], direction)
    if piece.kind == "box":
        return _slabs(np.vstack([np.eye(3), -np.eye(3)]), np.tile(piece.size, 2), o, d)
    if piece.kind == "convex":
        hull = ConvexHull(piece.vertices)
        return _slabs(hull.equations[:, :3], -hull.equations[:, 3], o, d)
    if piece.kind == "sphere":
        return _roots(d @ d, o @ d, o @ o - piece.size[0] ** 2)
    r, h = piece.size
    across = np.array([1.0, 1, 0])
    tube = _roots((d * across) @ d, (o * across) @ d, (o * across) @ o - r**2)
    caps = _slabs(np.array([[0, 0, 1.0], [0, 0, -1]]), np.array([h, h]), o, d)
    found = [_meet(tube, caps)]
    if piece.kind == "capsule":
        found += [_roots(d @ d, (o - c) @ d, (o - c) @ (o - c) - r**2) for c in (np.array([0, 0, -h]), np.array([0, 0, h]))]
    real = [f for f in found if f]
    return (min(f[0] for f in real), max(f[1] for f in real)) if real else None


def merged(intervals: list[Interval], gap: float = 5e-4) -> list[Interval]:
    """Sorted union of intervals; ones closer than `gap` are one."""
    out: list[Interval] = []
    for lower, upper in sorted(intervals):
        if out and lower <= out[-1][1] + gap:
            out[-1] = (out[-1][0], max(out[-1][1], upper))
        else:
            out.append((lower, upper))
    return out


def _slabs(normals: np.ndarray, offsets: np.ndarray, o: np.ndarray, d: np.ndarray) -> Interval | None:
    lower, upper = -np.inf, np.inf
    for n, c in zip(normals, offsets, strict=True):
        speed, room = n @ d, c - n @ o
        if abs(speed) < 1e-12:
            if room < 0:
                return None
        elif speed > 0:
            upper = min(upper, room / speed)
        else:
            lower = max(lower, room / speed)
    return (lower, upper) if lower < upper else None


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

"""Convex pieces of an object, how it stands, and its frames and grasps, by likeness to its
family.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
import trimesh
from scipy.spatial import ConvexHull
from trimesh.poses import compute_stable_poses

from pipeline.intake.robots.simplify import Cut, convex_parts, corners
from pipeline.poses import (
    IDENTITY,
    Bools,
    Floats,
    Ints,
    Pose,
    inverse,
    pose,
    quat_rotate,
    transform,
)
from pipeline.world.objects.contract import FAMILIES, Family, Grasp
from pipeline.world.objects.from_files import ObjectError, piece
from pipeline.world.shapes import Collider

CUT = Cut(threshold=0.06, pieces=14, resolution=500, iterations=20, hollow=1.15, tidy=True)


def solid_of(points: Floats, faces: Ints, name: str) -> tuple[Collider, ...]:
    """Convex pieces (m) of a mesh. Raises ObjectError for one that is flat."""
    try:
        parts = convex_parts(trimesh.Trimesh(points, faces), CUT)
        return tuple(piece(corners(part)) for part in parts)
    except Exception as error:  # qhull reports a flat mesh in errors of its own
        raise ObjectError(f"{name}: is flat; give it a thickness") from error


def ways_to_stand(pieces: Sequence[Collider]) -> list[tuple[Floats, float]]:
    """Up directions (3,) on a table, and how likely each is, likeliest first."""
    corners_of = [np.asarray(one.vertices) for one in pieces]
    hull = trimesh.convex.convex_hull(np.concatenate(corners_of))
    volumes = np.array([one.volume() for one in pieces])
    centres = np.array([trimesh.convex.convex_hull(points).center_mass for points in corners_of])
    stable = compute_stable_poses(hull, center_mass=volumes @ centres / volumes.sum())
    return [(np.array(turn[2, :3]), float(share)) for turn, share in zip(*stable, strict=True)]


def inside(pieces: Sequence[Collider], points: Floats) -> Bools:
    """Which points (N,3) of the body frame lie in one of the pieces."""
    return np.any([_in_piece(one, points) for one in pieces], axis=0)


def _in_piece(one: Collider, points: Floats) -> Bools:
    local = points if one.pose is IDENTITY else transform(inverse(one.pose), points)
    if one.kind == "box":
        return np.all(np.abs(local) <= one.size, axis=1)
    if one.kind == "convex":
        normals, offsets = planes(one)
        return np.all(local @ normals.T + offsets <= 0, axis=1)
    if one.kind == "sphere":
        return np.linalg.norm(local, axis=1) <= one.size[0]
    radius, half = one.size
    beyond = np.maximum(np.abs(local[:, 2]) - half, 0)
    across = np.linalg.norm(local[:, :2], axis=1)
    if one.kind == "capsule":
        return np.hypot(across, beyond) <= radius
    return (across <= radius) & (beyond == 0)


@lru_cache(maxsize=128)
def planes(one: Collider) -> tuple[Floats, Floats]:
    """Normals (K,3), offsets (K,) of a convex piece: inside, normals @ point + offsets <= 0."""
    equations = ConvexHull(np.asarray(one.vertices)).equations
    return equations[:, :3], equations[:, 3]


def bounds(pieces: Sequence[Collider]) -> Floats:
    """Lower and upper corner (2,3) m of the pieces."""
    points = np.concatenate([one.support_points() for one in pieces])
    return np.stack([points.min(0), points.max(0)])


AXES = {
    f"{sign}{axis}": value * row
    for sign, value in (("", 1.0), ("-", -1.0))
    for axis, row in zip("xyz", np.eye(3), strict=True)
}
# an object that rests on a side stands on the stable one within this of the side that is asked for
LEANING = np.radians(20)
LIKELIEST = 12  # sides tried where none is asked for
CELLS = 12  # per edge of the box in which two shapes are compared
PROPORTIONS = 0.5  # how much proportions count beside overlap
USUAL = 0.15  # advantage of the side that is up in the file


def stand_up(
    pieces: Sequence[Collider], family: str, up: str | None, usual: str, name: str
) -> Floats:
    """4x4 from the file's frame to z up, the base's origin and the family's heading. `up` None is
    the axis most like the family. Raises ObjectError if it falls."""
    ways = ways_to_stand(pieces)
    if up is None:
        near = [_nearest(ways, AXES[usual])]
        tried = [way for way in (*near, *(way for way, _ in ways[:LIKELIEST])) if way is not None]
    elif (nearest := _nearest(ways, AXES[up])) is not None:
        tried = [nearest]
    else:
        best = max(AXES, key=lambda axis: max((way @ AXES[axis]) + share for way, share in ways))
        raise ObjectError(f"{name}: does not stand with {up} up: it tips over; try --up {best}")

    def worth(turn: Floats) -> float:
        advantage = USUAL * (turn[2] @ AXES[usual] > 0.9)
        return round(float(_likeness(pieces, turn, family) + advantage), 6)

    return _place(pieces, max((turn for way in tried for turn in _turns(way)), key=worth), family)


def _nearest(ways: Sequence[tuple[Floats, float]], axis: Floats) -> Floats | None:
    way = max((way for way, _ in ways), key=lambda way: float(way @ axis), default=axis)
    return way if way @ axis > np.cos(LEANING) else None


def _turns(up: Floats) -> list[Floats]:
    ahead = np.eye(3)[np.argmin(np.abs(up))]
    x = ahead - up * (ahead @ up)
    x /= np.linalg.norm(x)
    y = np.cross(up, x)
    quarters = ((1, 0), (0, 1), (-1, 0), (0, -1))
    return [np.stack([c * x + s * y, c * y - s * x, up]) for c, s in quarters]


@cache
def _pattern(family: str) -> tuple[Floats, Bools, Floats]:
    """Bounds (2,3) of the family's first instance, filled cells, log proportions."""
    pieces = instance_of(family).shape().collision
    box = bounds(pieces)
    return box, inside(pieces, _cells(box)), _proportions(box)


def instance_of(family: str, seed: int = 0) -> Family:
    return FAMILIES[family].draw(np.random.Generator(np.random.Philox(seed)))


def _likeness(pieces: Sequence[Collider], turn: Floats, family: str) -> float:
    """Overlap of turned pieces and family in a common box, less their difference in proportions."""
    _, pattern, proportions = _pattern(family)
    points = np.concatenate([np.asarray(one.vertices) for one in pieces]) @ turn.T
    box = np.stack([points.min(0), points.max(0)])
    filled = inside(pieces, _cells(box) @ turn)
    overlap = (filled & pattern).sum() / max((filled | pattern).sum(), 1)
    return float(overlap - PROPORTIONS * np.abs(_proportions(box) - proportions).mean())


def _cells(box: Floats) -> Floats:
    steps = [(np.arange(CELLS) + 0.5) / CELLS] * 3
    shares = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 3)
    return box[0] + shares * (box[1] - box[0])


def _proportions(box: Floats) -> Floats:
    logs = np.log(np.maximum(box[1] - box[0], 1e-6))
    return logs - logs.mean()


def _place(pieces: Sequence[Collider], turn: Floats, family: str) -> Floats:
    """The turn, and the family's origin at the base."""
    points = np.concatenate([np.asarray(one.vertices) for one in pieces]) @ turn.T
    lower, upper = points.min(0), points.max(0)
    box = _pattern(family)[0]
    share = np.clip(-box[0, :2] / (box[1, :2] - box[0, :2]), 0, 1)
    out = np.eye(4)
    out[:3, :3] = turn
    out[:3, 3] = [*(-(lower[:2] + share * (upper[:2] - lower[:2]))), -lower[2]]
    return out


# m between tested points; m from its surface at which a family's frame lies on it
STEP, NEAR = 0.0005, 0.004
SHIFT = 0.35  # of the object's size: a surface farther from where the family has it is another one
# m that a quarter turn of approach or opening counts beside the distance of two grasps
TURNED = 0.15
WHOLE = {"base", "top"}


def frames_like(pieces: Sequence[Collider], family: str) -> dict[str, Pose]:
    """The frames (7,) that the family has, on the object."""
    model = instance_of(family)
    solid = model.shape().collision
    box, own = bounds(solid), bounds(pieces)
    frames = {"base": pose((0, 0, 0)), "top": pose((0, 0, own[1, 2]))}
    for name, at in model.frames().points.items():
        if name in WHOLE:
            continue
        share = (at[:3] - box[0]) / np.maximum(box[1] - box[0], 1e-6)
        place = own[0] + share * (own[1] - own[0])
        normal = quat_rotate(at[3:], [0.0, 0.0, 1.0])
        if _surfaces(solid, at[:3], normal, NEAR):
            size = float(np.linalg.norm(own[1] - own[0]))
            places = _surfaces(pieces, place, normal, SHIFT * size)
            place = place + normal * min(places, key=abs, default=0.0)
        frames[name] = np.concatenate([place, at[3:]])
    return frames


def _surfaces(pieces: Sequence[Collider], at: Floats, normal: Floats, reach: float) -> list[float]:
    """Distances (m) along the normal, within reach, at which material ends."""
    steps = np.arange(-reach, reach + STEP, STEP)
    solid = inside(pieces, at + steps[:, None] * normal)
    return [float(steps[i]) for i in np.flatnonzero(solid[:-1] & ~solid[1:])]


def kinds_like(
    grasps: Sequence[Grasp], pieces: Sequence[Collider], family: str
) -> tuple[Grasp, ...]:
    """The grasps with the kinds of the family's."""
    model = instance_of(family)
    known = model.frames().grasps
    if not known or not grasps:
        return tuple(grasps)
    theirs = _places(known, bounds(model.shape().collision))
    ours = _places(grasps, bounds(pieces))
    nearest = [int(np.argmin(np.linalg.norm(theirs - row, axis=1))) for row in ours]
    pairs = zip(grasps, nearest, strict=True)
    return tuple(replace(grasp, kind=known[i].kind) for grasp, i in pairs)


def _places(grasps: Sequence[Grasp], box: Floats) -> Floats:
    at = np.array([g.pose for g in grasps])
    share = (at[:, :3] - box[0]) / np.maximum(box[1] - box[0], 1e-6)
    x, y = (quat_rotate(at[:, 3:], np.eye(3)[k]) for k in (0, 1))
    return np.concatenate([share, TURNED * x, TURNED * np.abs(y)], axis=1)

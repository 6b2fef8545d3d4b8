"""Convex pieces of an object's mesh, tests of points against them, stable sides to stand on."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from trimesh.poses import compute_stable_poses

from pipeline.intake.robots.simplify import Cut, convex_parts, corners
from pipeline.poses import IDENTITY, Floats, inverse, transform
from pipeline.world.objects.from_files import ObjectError, piece
from pipeline.world.shapes import Collider

CUT = Cut(threshold=0.06, pieces=14, resolution=500, iterations=20, hollow=1.15, tidy=True)


def solid_of(points: Floats, faces: NDArray[np.int64], name: str) -> tuple[Collider, ...]:
    """Convex pieces (m) of a mesh. Raises ObjectError for one that is flat."""
    try:
        parts = convex_parts(trimesh.Trimesh(points, faces), CUT)
        return tuple(piece(corners(part)) for part in parts)
    except Exception as error:  # qhull reports a flat mesh in errors of its own
        raise ObjectError(f"{name}: is flat; give it a thickness") from error


def ways_to_stand(pieces: Sequence[Collider]) -> list[tuple[Floats, float]]:
    """Directions (3,) that can be up on a flat table, with their probabilities, likeliest first."""
    corners_of = [np.asarray(one.vertices) for one in pieces]
    hull = trimesh.convex.convex_hull(np.concatenate(corners_of))
    volumes = np.array([one.volume() for one in pieces])
    centres = np.array([trimesh.convex.convex_hull(points).center_mass for points in corners_of])
    stable = compute_stable_poses(hull, center_mass=volumes @ centres / volumes.sum())
    return [(np.array(turn[2, :3]), float(share)) for turn, share in zip(*stable, strict=True)]


def inside(pieces: Sequence[Collider], points: Floats) -> NDArray[np.bool_]:
    """Which points (N,3) of the body frame lie in one of the pieces."""
    return np.any([_in_piece(one, points) for one in pieces], axis=0)


def _in_piece(one: Collider, points: Floats) -> NDArray[np.bool_]:
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
    """Normals (K,3) and offsets (K,) of a convex piece: inside, normals @ point + offsets <= 0."""
    equations = ConvexHull(np.asarray(one.vertices)).equations
    return equations[:, :3], equations[:, 3]


def bounds(pieces: Sequence[Collider]) -> Floats:
    """Lower and upper corner (2,3) m of the pieces."""
    points = np.concatenate([one.support_points() for one in pieces])
    return np.stack([points.min(0), points.max(0)])

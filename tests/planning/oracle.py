"""Distances of collision pieces by coal, the independent reference of the collision kernels."""

from functools import cache

import coal  # pyright: ignore[reportMissingImports]  (on the path through cmeel's own path file)
import numpy as np

from pipeline.poses import Pose, compose, pose, quat_to_matrix
from pipeline.world.shapes import Collider


@cache
def coal_geometry(c: Collider) -> coal.CollisionGeometry:
    if c.kind == "box":
        return coal.Box(*(2 * np.array(c.size)))
    if c.kind == "sphere":
        return coal.Sphere(c.size[0])
    if c.kind == "cylinder":
        return coal.Cylinder(c.size[0], 2 * c.size[1])
    if c.kind == "capsule":
        return coal.Capsule(c.size[0], 2 * c.size[1])
    points = coal.StdVec_Vec3s()
    for v in np.asarray(c.vertices, float):
        points.append(v)
    return coal.ConvexBase.convexHull(points, False, "")


def coal_distance(a: Collider, pa: Pose, b: Collider, pb: Pose) -> float:
    """Signed distance in m, negative for penetration."""
    ta, tb = (
        coal.Transform3s(quat_to_matrix(p[3:]), p[:3])
        for p in (compose(pa, a.pose), compose(pb, b.pose))
    )
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return float(coal.distance(coal_geometry(a), ta, coal_geometry(b), tb, request, result))


def random_collider(rng: np.random.Generator, kind: str) -> Collider:
    at = pose(rng.uniform(-0.05, 0.05, 3), rng.normal(size=4))
    if kind == "convex":
        return Collider("convex", (), at, rng.uniform(-0.1, 0.1, (12, 3)) + 0.03)
    count = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2}[kind]
    return Collider(kind, tuple(rng.uniform(0.01, 0.12, count)), at)

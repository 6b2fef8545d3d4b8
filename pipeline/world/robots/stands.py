"""URDF origins, cameras, boxes, and what a single arm stands on."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Pose, compose, frame, pose, quat_from_rpy
from pipeline.world.objects import geometry
from pipeline.world.objects.surface import join
from pipeline.world.shapes import Collider, Material, Mesh, Parts

# RoboTwin 2.0 `static_camera_list`: the same head camera for every robot
HEAD_CAMERA = frame((-0.032, -0.45, 1.35), (0, 0.6, -0.8), (-1, 0, 0))
HEAD_CAMERA.setflags(write=False)

Triple = tuple[float, float, float]


def at(xyz: ArrayLike = (0, 0, 0), rpy: Triple = (0.0, 0.0, 0.0)) -> Pose:
    """Pose (7,) of a URDF `<origin xyz rpy>` (m, rad)."""
    return pose(xyz, quat_from_rpy(*rpy))


def wrist_camera(
    tcp: Pose, behind: float = 0.095, above: float = 0.085, pitch: float = 0.55
) -> Pose:
    """Pose (7,) in the hand link, `behind` and `above` the tool (m), pitched down (rad): fingers
    and held things up to 9 cm are in view."""
    return compose(tcp, at((-behind, 0, above), (0, pitch, 0)))


def box(lower: ArrayLike, upper: ArrayLike) -> Collider:
    """Box between two corners (3,), m."""
    a, b = np.asarray(lower, float), np.asarray(upper, float)
    return Collider("box", tuple(((b - a) / 2).tolist()), pose((a + b) / 2))


CHARCOAL = Material((0.17, 0.175, 0.185), roughness=0.5)
GREY = Material((0.42, 0.43, 0.45), roughness=0.5)
SILVER = Material((0.72, 0.73, 0.75), roughness=0.35, metallic=0.6)

Stand = tuple[Parts, tuple[Collider, ...]]

TABLE_EDGE = -0.35  # y of the table's edge on the robot's side, m
GAP = 0.003  # between the stand's collision and the base link, m


def pedestal(base: Triple, half: float) -> Stand:
    """A stand (world frame) for `base` (m) with a square foot of half edge `half` (m). Only the
    plate under the foot may reach over the table."""
    x, y, z = base
    column_y = min(y, TABLE_EDGE - 0.015 - half)
    front = max(y, column_y) + half
    width = half - 0.012
    left, right, back = x - half, x + half, column_y - half
    foot = block((left, back, z - 0.018), (right, front, z), 0.003)
    column = (x - width, column_y - width, 0.03), (x + width, column_y + width, z - 0.017)
    plate = (left - 0.05, back - 0.06, 0), (right + 0.05, column_y + half, 0.03)
    boards = (SILVER, [block(*column, 0.004)]), (GREY, [block(*plate, 0.004)])
    upper = box((left, back, z - 0.018), (right, front, z - GAP))
    lower = box((left, back, 0), (right, column_y + half, z - 0.018))
    return painted((CHARCOAL, [foot]), *boards), (upper, lower)


def block(lower: ArrayLike, upper: ArrayLike, bevel: float = 0.0) -> Mesh:
    """Box between two corners (3,), m, with chamfered edges."""
    a, b = np.asarray(lower, float), np.asarray(upper, float)
    return geometry.at(geometry.box(*((b - a) / 2), bevel=bevel), (a + b) / 2)


def painted(*groups: tuple[Material, Iterable[Mesh]]) -> Parts:
    """One joined mesh per material saves draw calls."""
    listed = ((material, tuple(meshes)) for material, meshes in groups)
    return tuple((join(*meshes), material) for material, meshes in listed if meshes)

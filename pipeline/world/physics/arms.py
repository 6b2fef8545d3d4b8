"""An arm's spec as a SAPIEN articulation with drives."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import sapien
from numpy.typing import ArrayLike
from sapien import physx
from sapien.physx import (
    PhysxArticulation,
    PhysxArticulationJoint,
    PhysxCollisionShape,
    PhysxCollisionShapeCapsule,
    PhysxCollisionShapeCylinder,
    PhysxMaterial,
)

from pipeline.data.joints import Joint
from pipeline.data.names import SIDES
from pipeline.poses import Floats, Pose, matrix, pose
from pipeline.world.robots.contract import (
    Arm,
    Gripper,
    Link,
    coupled_value,
    jaw_positions,
    root_link,
)
from pipeline.world.shapes import Collider

FRICTION = 1.2
_X_TO_Z = sapien.Pose(q=[0.7071068, 0, 0.7071068, 0])
_KINDS = {"revolute": "revolute_unwrapped", "prismatic": "prismatic", "fixed": "fixed"}


def to_sapien(p: Pose) -> sapien.Pose:
    return sapien.Pose(p[:3], p[3:])


@lru_cache(maxsize=16)
def arm_builder(arm: Arm) -> sapien.ArticulationBuilder:
    """An arm's builder without scene and shapes, its root fixed; bit-identical to SAPIEN's URDF
    loader."""
    builder = sapien.ArticulationBuilder()
    joints = {joint.child: joint for joint in arm.joints}
    links = {link.name: link for link in arm.links}
    made: dict[str, sapien.LinkBuilder] = {}
    below: dict[str, list[str]] = {}
    for joint in arm.joints:
        below.setdefault(joint.parent, []).append(joint.child)
    todo = [root_link(arm)]
    while todo:  # from the root, each branch whole, in joint order
        name = todo.pop()
        todo += reversed(below.get(name, ()))
        joint = joints.get(name)
        made[name] = one = builder.create_link_builder(
            None if joint is None else made[joint.parent]
        )
        one.set_name(name)
        one.set_joint_name("" if joint is None else joint.name)
        _set_mass(one, links[name])
        _set_joint(one, joint)
    return builder


def shape_of(
    piece: Collider, at: sapien.Pose, x_to_z: sapien.Pose, material: PhysxMaterial
) -> PhysxCollisionShape:
    """A piece at `at`; one that SAPIEN lays along x is turned by `x_to_z`."""
    if piece.kind == "box":
        shape = physx.PhysxCollisionShapeBox(piece.size, material)
    elif piece.kind == "sphere":
        shape = physx.PhysxCollisionShapeSphere(piece.size[0], material)
    elif piece.kind == "convex":
        points = np.asarray(piece.vertices, np.float32)
        shape = physx.PhysxCollisionShapeConvexMesh(points, (1.0, 1.0, 1.0), material)
    else:
        lies = {"cylinder": PhysxCollisionShapeCylinder, "capsule": PhysxCollisionShapeCapsule}
        shape, at = lies[piece.kind](*piece.size, material), at * x_to_z
    shape.set_local_pose(at)
    return shape


def _set_mass(builder: "sapien.LinkBuilder", link: Link) -> None:
    (xx, yy, zz), (xy, xz, yz) = link.inertia, link.products
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments, axes = np.diag(inertia), np.eye(3)
    if any(link.products):
        moments, axes = np.linalg.eigh(inertia)
        if np.linalg.det(axes) < 0:
            axes[:, 2] = -axes[:, 2]
    builder.set_mass_and_inertia(link.mass, _at(pose(link.com)) * _turned(axes), moments)


def _set_joint(builder: "sapien.LinkBuilder", joint: Joint | None) -> None:
    if joint is None:
        builder.set_joint_properties("fixed", [], sapien.Pose(), sapien.Pose())
        return
    # a joint of SAPIEN moves along or about x
    axis = np.array((1.0, 0.0, 0.0) if joint.kind == "fixed" else joint.axis)
    axis /= np.linalg.norm(axis)
    second = np.cross(axis, (0, 0, 1) if abs(axis[0]) > 0.9 else (1, 0, 0))
    second /= np.linalg.norm(second)
    turn = _turned(np.stack([axis, second, np.cross(axis, second)], 1))
    limits = [] if joint.kind == "fixed" else [[joint.lower, joint.upper]]
    builder.set_joint_properties(_KINDS[joint.kind], limits, _at(joint.origin) * turn, turn)


def _at(p: Pose) -> sapien.Pose:
    # from a matrix, as SAPIEN reads a URDF: its quaternion is rounded otherwise than ours
    return sapien.Pose(matrix(p))


def _turned(axes: ArrayLike) -> sapien.Pose:
    out = np.eye(4)
    out[:3, :3] = axes
    return sapien.Pose(out)


@dataclass(eq=False)
class BuiltArm:
    """An arm in a scene: articulation, all active joints, those of arm and jaws in spec order."""

    robot: PhysxArticulation
    active: list[PhysxArticulationJoint]
    joints: list[PhysxArticulationJoint]
    jaws: list[PhysxArticulationJoint]
    gripper: Gripper

    def __post_init__(self) -> None:
        driven = (*self.joints, *self.jaws)
        self._aim = [joint.set_drive_target for joint in driven]
        self._rate = [joint.set_drive_velocity_target for joint in driven]
        ends = zip(self.gripper.closed, self.gripper.opened, strict=True)
        self._travels = [(closed, opened - closed) for closed, opened in ends]
        self._goals, self._speeds = [math.nan] * len(driven), list[float]()

    def drive(self, command: Floats, velocity: Floats) -> None:
        """Set the next step's drives: positions and velocities (n+1,), gripper 0-1, 1/s."""
        *goals, value = command.tolist()
        *speeds, rate = velocity.tolist()
        if len(self.jaws) > 2:
            value = coupled_value(self.gripper, self.jaw_positions(), value)
        for closed, travel in self._travels:
            goals.append(closed + value * travel)
            speeds.append(rate * travel)
        for aim, goal, before in zip(self._aim, goals, self._goals, strict=True):
            if goal != before:
                aim(goal)
        if speeds != self._speeds:  # within a control period they are the same
            for set_rate, speed in zip(self._rate, speeds, strict=True):
                set_rate(speed)
        self._goals, self._speeds = goals, speeds
        self.robot.set_qf(self.robot.compute_passive_force())

    def jaw_positions(self) -> Floats:
        """Measured jaw positions (J,), m or rad."""
        by_name = {joint.name: q for joint, q in zip(self.active, self.robot.qpos, strict=True)}
        return np.array([by_name[joint.name] for joint in self.jaws], float)


def add_arm(scene: sapien.Scene, side: str, arm: Arm) -> BuiltArm:
    """An arm at its base and home, gripper open, drives set."""
    builder = arm_builder(arm)
    builder.set_scene(scene)
    robot = builder.build()
    robot.set_root_pose(to_sapien(arm.base))
    collision = {link.name: link.collision for link in arm.links}
    material = PhysxMaterial(FRICTION, FRICTION, 0.0)
    for link in robot.links:
        link.entity.name = f"{side}_{link.name}"
        for piece in collision[link.name]:
            shape = shape_of(piece, _at(piece.pose), _X_TO_Z, material)
            # contacts between arms, none within one
            shape.set_collision_groups([1, 1, 1 << 29, 1 + SIDES.index(side)])
            link.attach(shape)
    active = list(robot.active_joints)
    by_name = {j.name: j for j in active}
    limits = {j.name: j for j in arm.joints}
    for name in arm.arm_joints:
        joint = by_name[name]
        joint.set_drive_properties(arm.stiffness, arm.damping, limits[name].effort, "force")
        joint.set_friction(0.0)
    for name in arm.gripper.joints:
        by_name[name].set_drive_properties(
            arm.gripper.stiffness, arm.gripper.damping, arm.gripper.force, "force"
        )
        by_name[name].set_friction(0.0)
    qpos = dict(zip(arm.arm_joints, arm.home, strict=True)) | dict(
        zip(arm.gripper.joints, jaw_positions(arm.gripper, 1.0), strict=True)
    )
    robot.set_qpos(np.array([qpos[j.name] for j in active]))
    return BuiltArm(
        robot,
        active,
        [by_name[n] for n in arm.arm_joints],
        [by_name[n] for n in arm.gripper.joints],
        arm.gripper,
    )

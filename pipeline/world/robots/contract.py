"""Embodiments as plain data, their forward kinematics and checks. Joint and link names are local to
an arm; in the world they carry its side: `left_joint1`."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.errors import DominoError
from pipeline.data.joints import Joint, joint_motion
from pipeline.poses import Pose, compose
from pipeline.world.files import Table
from pipeline.world.shapes import Collider, Parts


@dataclass(frozen=True, eq=False)
class Link:
    """Mass kg, centre of mass m, inertia (ixx, iyy, izz) and products (ixy, ixz, iyz) kg m2 about
    it, along the link's axes."""

    name: str
    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float]
    visual: Parts = ()
    collision: tuple[Collider, ...] = ()
    products: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Gripper:
    """Two fingers moved by coupled joints: slides, a linkage, or one hinged jaw. The normalised
    value is linear from 0 at `closed` to 1 at `opened` (m or rad). A table of `robot.toml`."""

    __pydantic_config__ = Table.model_config

    joints: tuple[str, ...]
    fingers: tuple[str, str]  # link names of the fingers; the hand for a jaw that is part of it
    closed: tuple[float, ...]
    opened: tuple[float, ...]
    opening: float  # m between the pads
    force: float = 40.0  # N or N m, limit per joint
    speed: float = 0.2  # m/s or rad/s of the first joint
    stiffness: float = 1500.0  # N/m or N m/rad of each joint's drive
    damping: float = 60.0


@dataclass(frozen=True, eq=False)
class Mount:
    """Camera pose in the link frame, x forward, z up."""

    link: str
    pose: Pose


@dataclass(frozen=True, eq=False)
class Arm:
    """One arm. `base` places its root link in the world, `tcp` is the tool frame in `hand` (x
    approach, y opening)."""

    model: str
    base: Pose
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]  # in tree order, fixed joints and jaws included
    arm_joints: tuple[str, ...]
    hand: str
    tcp: Pose
    gripper: Gripper
    home: tuple[float, ...]
    camera: Mount
    stiffness: float = 5000.0
    damping: float = 500.0
    acceleration: float = 10.0  # rad/s2, planning limit
    # reviewed link pairs whose collision pieces overlap at rest
    allowed_overlap: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Embodiment:
    """Arms by side, left before right, furniture and head camera (x forward, z up) in the world
    frame."""

    name: str
    arms: dict[str, Arm]
    head_camera: Pose
    furniture: Parts = ()
    furniture_collision: tuple[Collider, ...] = ()
    aliases: tuple[str, ...] = ()

    @property
    def vector_names(self) -> tuple[str, ...]:
        joints = {side: (*arm.arm_joints, "gripper") for side, arm in self.arms.items()}
        return tuple(f"{side}_{name}" for side, names in joints.items() for name in names)

    @property
    def sides(self) -> tuple[str, ...]:
        return tuple(self.arms)


def jaw_positions(gripper: Gripper, value: float) -> np.ndarray:
    """Joint positions (J,) in m or rad for 0 (closed) to 1."""
    return np.array(gripper.closed) + value * (np.array(gripper.opened) - np.array(gripper.closed))


def jaw_value(gripper: Gripper, positions: np.ndarray) -> float:
    """Value 0-1, the mean of jaw positions (J,)."""
    closed, opened = np.array(gripper.closed), np.array(gripper.opened)
    return float(np.mean((positions - closed) / (opened - closed)))


LEAD = 0.05
"""Share of its travel by which a linkage's joints are driven ahead of where they are."""


def coupled_value(gripper: Gripper, positions: np.ndarray, value: float) -> float:
    """The driven value for a commanded one: in a linkage at most LEAD from the mean of `positions`
    (J,), so that all stop at an object."""
    if len(gripper.joints) <= 2:
        return value
    now = jaw_value(gripper, positions)
    return min(max(value, now - LEAD), now + LEAD)


def link_poses(arm: Arm, positions: Mapping[str, ArrayLike]) -> dict[str, Pose]:
    """World poses (..., 7) of every link by local name; missing joints are at 0."""
    poses = {root_link(arm): np.array(arm.base)}
    for joint in arm.joints:
        local = compose(joint.origin, joint_motion(joint, positions.get(joint.name, 0.0)))
        poses[joint.child] = compose(poses[joint.parent], local)
    return poses


def arm_poses(arm: Arm, q: ArrayLike, gripper: float = 1.0) -> dict[str, Pose]:
    """Like `link_poses` for an arm configuration (dof,) rad and a gripper value 0-1."""
    jaws = jaw_positions(arm.gripper, gripper).tolist()
    names, positions = (*arm.arm_joints, *arm.gripper.joints), (*np.asarray(q, float), *jaws)
    return link_poses(arm, dict(zip(names, positions, strict=True)))


def root_link(arm: Arm) -> str:
    moved = {joint.child for joint in arm.joints}
    return next(link.name for link in arm.links if link.name not in moved)


class RobotError(DominoError):
    """A robot whose spec is not sound."""


def check_arm(name: str, side: str, arm: Arm) -> None:
    """Raise RobotError for the first fault that reading a URDF does not refuse."""
    for problem in chain(_tree(arm), _frames(arm), _drives(arm), _numbers(arm)):
        raise RobotError(f"robot {name!r}, {side} arm: {problem}")


def _tree(arm: Arm) -> Iterator[str]:
    moved = {joint.child for joint in arm.joints}
    roots = [link.name for link in arm.links if link.name not in moved]
    if len(roots) != 1:
        loose = f"links {', '.join(map(repr, roots))} hang on no joint"
        problem = loose if roots else "its joints form a ring"
        yield f"{problem}: every link but the base needs one joint above it"
    placed = set(roots)
    for joint in arm.joints:
        if joint.parent not in placed:
            yield f"joint {joint.name!r} comes before that of its parent: list joints from the base"
        placed.add(joint.child)


def _drives(arm: Arm) -> Iterator[str]:
    joints, jaws = {j.name: j for j in arm.joints}, arm.gripper
    for name in jaws.joints:
        if name not in joints:
            yield _missing("gripper.joints", name, "joints", joints)
        elif joints[name].kind == "fixed":
            yield f"gripper.joints names {name!r}, which is fixed"
    for name, joint in joints.items():
        if joint.kind == "fixed":
            continue
        if name not in (*arm.arm_joints, *jaws.joints):
            yield f"joint {name!r} moves but nothing drives it: drive it, or make it fixed"
        if not (joint.lower < joint.upper and joint.velocity > 0 and joint.effort > 0):
            yield f"joint {name!r} needs limits lower < upper, a velocity and an effort above 0"
    if len(arm.home) != len(arm.arm_joints):
        yield f"home has {len(arm.home)} values for {len(arm.arm_joints)} arm_joints"
    for field, names, values in (
        ("home", arm.arm_joints, arm.home),
        ("gripper.closed", jaws.joints, jaws.closed),
        ("gripper.opened", jaws.joints, jaws.opened),
    ):
        for name, value in zip(names, values, strict=False):
            low, high = joints[name].lower, joints[name].upper
            if not low - 1e-9 <= value <= high + 1e-9:
                yield f"{field} puts joint {name!r} at {value:g}, outside {low:g} to {high:g}"


def _frames(arm: Arm) -> Iterator[str]:
    links = [link.name for link in arm.links]
    named = {
        "hand": (arm.hand,),
        "gripper.fingers": arm.gripper.fingers,
        "allowed_overlap": chain(*arm.allowed_overlap),
    }
    for field, names in named.items():
        yield from (_missing(field, name, "links", links) for name in names if name not in links)


def _numbers(arm: Arm) -> Iterator[str]:
    for field, pose in (("base", arm.base), ("tcp", arm.tcp)):
        p = np.asarray(pose, float)
        if p.shape != (7,) or not np.isfinite(p).all() or abs(np.linalg.norm(p[3:]) - 1) > 1e-6:
            yield f"{field} is no pose: give x, y, z and a unit quaternion w, x, y, z"
    for link in arm.links:
        if not (link.mass > 0 and min(link.inertia) > 0):
            yield f"link {link.name!r} needs a mass and inertia above 0"


def _missing(field: str, name: str, what: str, existing: Iterable[str]) -> str:
    fix = f"use one of {', '.join(existing)}"
    return f"{field} names {name!r}, which is missing from {what}: {fix}"

"""Robots and colliders as kernel arrays, and swept bodies."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pipeline.poses import (
    IDENTITY,
    Bools,
    Floats,
    Ints,
    Pose,
    compose,
    from_matrix,
    inverse,
    quat_to_matrix,
)
from pipeline.world.robots.contract import Arm
from pipeline.world.shapes import Collider

from . import collision_kernels as kernels
from .collision_kernels import first_swept_contact, place_pieces
from .kinematics import z_onto

KINDS = {
    "box": kernels.BOX,
    "cylinder": kernels.CYLINDER,
    "sphere": kernels.SEGMENT,
    "capsule": kernels.SEGMENT,
    "convex": kernels.POINTS,
}


@dataclass(frozen=True, eq=False)
class Frames:
    """Joint frames (F), parent 0 the world, placement (F,12), axis on local z."""

    names: tuple[str, ...]
    parent: Ints
    origin: Floats
    prismatic: Bools


class Pieces(NamedTuple):
    """P convex pieces: owner and frame index, placement (P,12) in that frame, the core in m, and
    the `radius` of the ball that sweeps it.
    """

    owner: Ints
    frame: Ints
    local: Floats
    core: Ints
    size: Floats
    radius: Floats
    half: Floats
    bound: Floats
    points: Floats

    def joined(self, other: "Pieces") -> "Pieces":
        """Followed by others whose vertex ranges count from 0."""
        shift = np.array([0, len(self.points), len(self.points)])
        after = other._replace(core=other.core + shift)
        columns: Any = (np.concatenate(both) for both in zip(self, after, strict=True))
        return Pieces(*columns)


def frames_of(arms: Sequence[tuple[str, Arm]]) -> tuple[Frames, dict[str, tuple[int, Pose]]]:
    """Joint frames of (name prefix, arm), and (frame index, pose (7,)) by prefixed link. Raises
    ValueError for a foreign movable joint.
    """
    names, parents, origins, prismatic = [], [], [], []
    links: dict[str, tuple[int, Pose]] = {}
    for prefix, arm in arms:
        order = (*arm.arm_joints, *arm.gripper.joints)
        first = 1 + len(names)
        moving = [j.name for j in arm.joints if j.kind != "fixed"]
        if sorted(moving) != sorted(order):
            raise ValueError(f"{arm.model}: movable joints {moving} are not {list(order)}")
        children = {j.child for j in arm.joints}
        roots = (link.name for link in arm.links if link.name not in children)
        links |= {prefix + name: (0, arm.base) for name in roots}
        rows = {}
        for joint in arm.joints:
            frame, at = links[prefix + joint.parent]
            at = compose(at, joint.origin)
            if joint.kind == "fixed":
                links[prefix + joint.child] = frame, at
                continue
            turn = from_matrix(z_onto(np.asarray(joint.axis, float)))
            rows[joint.name] = frame, compose(at, turn), joint.kind == "prismatic"
            links[prefix + joint.child] = first + order.index(joint.name), inverse(turn)
        for name in order:
            frame, at, slides = rows[name]
            names.append(prefix + name)
            parents.append(frame)
            origins.append(transform_rows(at))
            prismatic.append(slides)
    return Frames(tuple(names), np.array(parents), np.array(origins), np.array(prismatic)), links


def groups_of(
    arms: dict[str, Arm], frames: Frames, placed: dict[str, tuple[int, Pose]]
) -> tuple[dict[str, frozenset[str]], dict[str, tuple[int, Pose]]]:
    groups: dict[str, frozenset[str]] = {}
    hands = {}
    for side, arm in arms.items():
        frame, at = placed[f"{side}_{arm.hand}"]
        hands[side] = frame, compose(at, arm.tcp)
        jaws = {frames.names.index(f"{side}_{name}") + 1 for name in arm.gripper.joints}
        # a jaw that is part of the hand does not move
        named = {f"{side}_{name}" for name in arm.gripper.fingers}
        fingers = frozenset(n for n, (f, _) in placed.items() if f in jaws or n in named)
        groups[f"{side}_fingers"] = fingers
        groups[f"{side}_hand"] = fingers | {n for n, (f, _) in placed.items() if f == frame}
        groups[side] = frozenset(n for n in placed if n.startswith(f"{side}_"))
    return groups, hands


def pieces_of(entries: Sequence[tuple[int, int, Collider, Pose]]) -> Pieces:
    """Pieces from (owner index, frame index, collider, pose (7,) of its body in that frame). Raises
    ValueError for an unknown kind."""
    count = len(entries)
    core, size, half = np.zeros((count, 3), np.int64), np.zeros((count, 3)), np.zeros((count, 3))
    radius, centre, total = np.zeros(count), np.zeros((count, 7)), 0
    centre[:, 3] = 1.0
    clouds: list[Floats] = [np.zeros((0, 3))]
    for i, (_, _, collider, _) in enumerate(entries):
        if collider.kind not in KINDS:
            what = f"a collision piece of kind {collider.kind!r}"
            raise ValueError(f"{what}: choose {', '.join(KINDS)}")
        core[i, 0] = KINDS[collider.kind]
        if collider.kind == "box":
            size[i] = half[i] = collider.size
        elif collider.kind == "convex":
            vertices = np.asarray(collider.vertices, float)
            centre[i, :3] = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
            clouds.append(np.asarray(vertices - centre[i, :3]))
            half[i] = np.abs(clouds[-1]).max(axis=0)
            core[i, 1:] = total, total + len(vertices)
            total += len(vertices)
        elif collider.kind == "cylinder":
            size[i] = half[i] = collider.size[0], collider.size[0], collider.size[1]
        else:
            radius[i] = collider.size[0]
            size[i, 2] = half[i, 2] = collider.size[1] if collider.kind == "capsule" else 0.0
    is_cylinder = core[:, 0] == kernels.CYLINDER
    bound = np.where(is_cylinder, np.hypot(size[:, 0], size[:, 2]), np.linalg.norm(half, axis=1))
    bodies = np.array([body for *_, body in entries]).reshape(-1, 7)
    placed = np.array([collider.pose for _, _, collider, _ in entries]).reshape(-1, 7)
    at = compose(compose(bodies, placed), centre)
    local = transform_rows(at)
    owner, frame = (np.array([entry[k] for entry in entries], np.int64) for k in (0, 1))
    return Pieces(owner, frame, local, core, size, radius, half, bound, np.concatenate(clouds))


def transform_rows(poses: Floats) -> Floats:
    """Poses (...,7) as rows (...,12)."""
    rotation = quat_to_matrix(poses[..., 3:]).reshape(*poses.shape[:-1], 9)
    return np.concatenate([rotation, poses[..., :3]], axis=-1)


def bounding_ball(pieces: Pieces) -> Floats:
    """Ball (x, y, z, radius) around pieces of one frame, in that frame."""
    extent = (pieces.bound + pieces.radius)[:, None]
    centres = pieces.local[:, 9:]
    middle = 0.5 * ((centres - extent).min(axis=0) + (centres + extent).max(axis=0))
    return np.append(middle, (np.linalg.norm(centres - middle, axis=1) + extent[:, 0]).max())


class Sweep:
    """Recorded bodies, tested against motions of another."""

    def __init__(
        self,
        pieces: Sequence[tuple[int, Collider]],
        poses: Floats,
        own: Sequence[Collider],
        margin: float,
    ) -> None:
        """`pieces` are (body index, collider) of bodies at world `poses` (S,B,7); those within
        `margin` (m) are in contact."""
        others = pieces_of([(index, index, c, IDENTITY) for index, c in pieces])
        mine = pieces_of([(0, 0, c, IDENTITY) for c in own])
        self._pieces, self._count = others.joined(mine), len(pieces)
        self._margin, self._ball = margin, bounding_ball(mine)
        self._placed = np.empty((len(poses), len(pieces) + len(own), 12))
        place_pieces(transform_rows(poses), others.frame, others.local, self._placed)

    def first_contact(self, poses: Floats) -> int | None:
        """Index of the first pose (S,7) in contact, or None. Raises ValueError."""
        if len(poses) != len(self._placed):
            raise ValueError(f"{len(poses)} poses of a body, {len(self._placed)} recorded ones")
        at = transform_rows(poses)
        row = first_swept_contact(
            tuple(self._pieces), self._placed, self._count, at, self._ball, self._margin
        )
        return None if row < 0 else row

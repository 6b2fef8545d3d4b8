"""Actions as joints or tool poses; absolute, relative or delta; conversions both ways.

*Relative* is against the measured state at prediction, *delta* against the action before. Tool
poses are then inverse(reference) * pose, as in UMI. Grippers (0 closed, 1 open) are absolute.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.poses import Floats, Pose, compose, inverse, quat_from_matrix, quat_to_matrix

from .names import sides_of

ACTIONS = ("joints", "ee", "ee-relative", "ee-delta", "joints-relative", "joints-delta")
ROTATIONS = {
    "quaternion": ("qw", "qx", "qy", "qz"),
    "axis-angle": ("rx", "ry", "rz"),
    "6d": ("r00", "r10", "r20", "r01", "r11", "r21"),
}
"""Names of a rotation's numbers; `6d` are the first two columns of the matrix."""
FRAMES = ("world", "base")
SMALLEST = 1e-6  # shorter rotations of a policy have no direction


class ToolKinematics(Protocol):
    """What conversions need of an arm."""

    @property
    def base(self) -> Pose: ...  # world pose (7,)

    def poses(self, q: ArrayLike) -> Floats:
        """World poses (T,7) of the tool for joints (T,n)."""
        ...


@dataclass(frozen=True)
class Representation:
    """How actions are written; `rotation` and `frame` are those of tool poses. Raises
    ValueError."""

    actions: str = "joints"
    rotation: str = "quaternion"
    frame: str = "world"

    def __post_init__(self) -> None:
        for name, words in (("actions", ACTIONS), ("rotation", ROTATIONS), ("frame", FRAMES)):
            if (word := getattr(self, name)) not in words:
                raise ValueError(f"{name} {word!r} is unknown: choose {', '.join(words)}")

    @property
    def kind(self) -> str:
        """What is written: joints, or the pose of the end effector (ee)."""
        return self.actions.partition("-")[0]

    @property
    def poses(self) -> bool:
        return self.kind == "ee"

    @property
    def reference(self) -> str:
        """What actions are against: absolute, relative or delta."""
        return self.actions.partition("-")[2] or "absolute"

    def names(self, vector_names: Sequence[str]) -> tuple[str, ...]:
        """The name of each number of an action."""
        if not self.poses:
            return tuple(vector_names)
        parts = ("x", "y", "z", *ROTATIONS[self.rotation], "gripper")
        return tuple(f"{side}_{part}" for side in sides_of(vector_names) for part in parts)

    def slices(self, vector_names: Sequence[str]) -> dict[str, slice]:
        """Slices of an action by part, such as left_joints and left_gripper, left before right."""
        out: dict[str, slice] = {}
        for i, name in enumerate(self.names(vector_names)):
            side, _, number = name.partition("_")
            kind = "gripper" if number == "gripper" else "joints"
            if self.poses and kind == "joints":
                kind = "position" if number in ("x", "y", "z") else "rotation"
            part = f"{side}_{kind}"
            out[part] = slice(out[part].start if part in out else i, i + 1)
        return out

    def describe(self) -> str:
        """One sentence."""
        against = {
            "absolute": "",
            "relative": " relative to the measured state at the moment of prediction",
            "delta": " relative to the action before",
        }[self.reference]
        if not self.poses:
            when = "(rad, grippers 0-1 absolute) for the interval after the frame"
            return f"joint targets{against} {when}"
        rotation = {
            "quaternion": "quaternion w x y z",
            "axis-angle": "rotation vector (rad)",
            "6d": "first two columns of the rotation matrix, one after the other",
        }[self.rotation]
        frame = {"world": "world frame", "base": "frame of the arm's base"}[self.frame]
        where = frame if self.reference == "absolute" else "frame of the reference tool"
        return (
            f"tool poses{against} for the interval after the frame: per arm x y z (m), {rotation},"
            f" in the {where}, and gripper (0-1, absolute)"
        )


JOINTS = Representation()


@dataclass(frozen=True, eq=False)
class ActionCodec:
    """Conversions for joint vectors (A,); tool poses need `arms` by side."""

    representation: Representation
    vector_names: tuple[str, ...]
    arms: Mapping[str, ToolKinematics] = field(default_factory=dict[str, ToolKinematics])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of an action's D numbers."""
        return self.representation.names(self.vector_names)

    @cached_property
    def _relative(self) -> Floats:
        """(A,) 1 where differences are taken: not of grippers."""
        return np.array([float(not name.endswith("_gripper")) for name in self.vector_names])

    def references(self, commanded: Floats, measured: Floats) -> Floats:
        """What the actions (T,A) of an episode are written against, in joints (T,A)."""
        if self.representation.reference == "delta":
            return np.vstack([measured[:1], commanded[:-1]])
        return measured

    def encode(self, commanded: Floats, references: Floats) -> Floats:
        """Joint targets (T,A) as actions (T,D) against references (T,A). Only absolute
        quaternions have continuous signs.
        """
        representation = self.representation
        if not representation.poses:
            if representation.reference == "absolute":
                return commanded
            return commanded - references * self._relative
        poses, grippers = self.tools(commanded)
        if representation.reference == "absolute":
            poses = self._moved(poses, to_world=False)
        else:
            poses = compose(inverse(self.tools(references)[0]), poses)
        poses[..., 3:] = continuous_signs(poses[..., 3:], representation.reference == "absolute")
        return self._written(poses, grippers)

    def decode_joints(self, actions: Floats, state: Floats, before: Floats) -> Floats:
        """Joint targets (H,A) of a chunk (H,A), given the measured `state` and commanded
        `before` (A,).
        """
        reference = self.representation.reference
        if reference == "absolute":
            return actions
        if reference == "relative":
            return actions + state * self._relative
        summed = before + np.cumsum(actions, axis=0)
        return np.where(self._relative > 0, summed, actions)

    def decode_tools(self, actions: Floats, state: Floats, before: Floats) -> tuple[Floats, Floats]:
        """World tool poses (H,S,7) and gripper values (H,S) of a chunk (H,D). Raises ValueError
        for a zero rotation.
        """
        sides, width = len(sides_of(self.vector_names)), len(self.names)
        rows = np.asarray(actions, float).reshape(len(actions), sides, width // sides)
        grippers = rows[..., -1]
        poses = np.empty((len(rows), sides, 7))
        poses[..., :3] = rows[..., :3]
        poses[..., 3:] = quaternions_of(rows[..., 3:-1], self.representation.rotation)
        reference = self.representation.reference
        if reference == "absolute":
            return self._moved(poses, to_world=True), grippers
        at = self.tools((state if reference == "relative" else before)[None])[0][0]
        if reference == "relative":
            return compose(at, poses), grippers
        for row in poses:
            row[:] = at = compose(at, row)
            row[:, 3:] /= np.linalg.norm(row[:, 3:], axis=-1, keepdims=True)
        return poses, grippers

    def tools(self, joints: Floats) -> tuple[Floats, Floats]:
        """World poses (T,S,7) of the tools and gripper values (T,S) for joint vectors (T,A)."""
        poses, grippers = [], []
        for side in sides_of(self.vector_names):
            at = [i for i, name in enumerate(self.vector_names) if name.startswith(f"{side}_")]
            gripper = self.vector_names.index(f"{side}_gripper")
            poses.append(self.arms[side].poses(joints[:, [i for i in at if i != gripper]]))
            grippers.append(joints[:, gripper])
        return np.stack(poses, 1), np.stack(grippers, 1)

    def _moved(self, poses: Floats, to_world: bool) -> Floats:
        """World poses (T,S,7) in the representation's frame, or back."""
        if self.representation.frame == "world":
            return poses
        bases = np.stack([self.arms[side].base for side in sides_of(self.vector_names)])
        return compose(bases if to_world else inverse(bases), poses)

    def _written(self, poses: Floats, grippers: Floats) -> Floats:
        rotations = rotations_of(poses[..., 3:], self.representation.rotation)
        rows = np.concatenate([poses[..., :3], rotations, grippers[..., None]], -1)
        return rows.reshape(len(rows), -1)


def rotations_of(q: ArrayLike, rotation: str) -> Floats:
    """Unit quaternions wxyz (...,4) in one of ROTATIONS; rotation vectors take the short way."""
    q = np.asarray(q, float)
    if rotation == "quaternion":
        return q
    if rotation == "6d":
        matrix = quat_to_matrix(q)
        return np.concatenate([matrix[..., 0], matrix[..., 1]], -1)
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., :1])
    small = sine < 1e-12
    return q[..., 1:] * np.where(small, 2.0, angle / np.where(small, 1.0, sine))


def quaternions_of(values: ArrayLike, rotation: str) -> Floats:
    """Inverse of `rotations_of`, normalising. Raises ValueError for a zero rotation."""
    values = np.asarray(values, float)
    if rotation == "axis-angle":
        angle = np.linalg.norm(values, axis=-1, keepdims=True)
        share = np.sinc(angle / (2 * np.pi)) / 2  # sin(a/2)/a
        return np.concatenate([np.cos(angle / 2), values * share], -1)
    if rotation == "quaternion":
        return _unit(values)
    x = _unit(values[..., :3])
    y = _unit(values[..., 3:] - x * np.sum(x * values[..., 3:], -1, keepdims=True))
    matrices = np.stack([x, y, np.cross(x, y)], -1)
    quaternions = [quat_from_matrix(matrix) for matrix in matrices.reshape(-1, 3, 3)]
    return np.array(quaternions).reshape(*matrices.shape[:-2], 4)


def continuous_signs(q: Floats, along_time: bool = True) -> Floats:
    """Quaternions (T,...,4), the first with w >= 0, others on the side of the one before."""
    q = np.where(q[..., :1] < 0, -q, q)
    if not along_time or len(q) < 2:
        return q
    flips = np.where(np.sum(q[1:] * q[:-1], -1, keepdims=True) < 0, -1.0, 1.0)
    return np.concatenate([q[:1], q[1:] * np.cumprod(flips, axis=0)])


def _unit(values: NDArray[Any]) -> Floats:
    length = np.linalg.norm(values, axis=-1, keepdims=True)
    if (length < SMALLEST).any():
        raise ValueError("a rotation has the length zero")
    return values / length

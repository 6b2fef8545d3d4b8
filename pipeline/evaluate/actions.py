"""Bounds of actions, drive targets at the physics rate, and tool poses."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.actions import ActionCodec, Representation
from pipeline.data.errors import DominoError
from pipeline.planning.budgets import IK, IkBudget
from pipeline.planning.kinematics import Chain, fk_batch, ik_many
from pipeline.planning.planner import Planner, planner_of
from pipeline.poses import Floats, Pose, compose
from pipeline.world.robots.contract import Embodiment

POSE_NAMES = ("x", "y", "z", "qw", "qx", "qy", "qz")  # m in the world frame, quaternion wxyz


class ActionError(DominoError): ...


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Bounds of a joint action (A,): positions, and the largest change in one second."""

    names: tuple[str, ...]
    lower: Floats
    upper: Floats
    speed: Floats

    def clipped(self, action: Floats, before: Floats, seconds: float) -> Floats:
        # np.clip costs five times as much on so few numbers
        action = np.minimum(np.maximum(action, self.lower), self.upper)
        reach = self.speed * seconds
        return np.minimum(np.maximum(action, before - reach), before + reach)


@lru_cache(maxsize=8)
def joint_limits(embodiment: Embodiment) -> JointLimits:
    """Limits of the arm joints (rad or m, per s); grippers run over 0-1 at any speed."""
    rows = list[tuple[float, float, float]]()
    for arm in embodiment.arms.values():
        joints = {j.name: j for j in arm.joints}
        named = (joints[name] for name in arm.arm_joints)
        rows += [*((j.lower, j.upper, j.velocity) for j in named), (0.0, 1.0, np.inf)]
    return JointLimits(embodiment.vector_names, *np.array(rows).T.copy())


def check_action(action: ArrayLike, length: int) -> Floats:
    """The action as float64 (length,). Raises ActionError."""
    try:
        values = np.asarray(action, np.float64)
    except (TypeError, ValueError) as error:
        raise ActionError(f"the action is not an array of numbers: {error}") from error
    if values.shape != (length,):
        raise ActionError(f"the action has the shape {values.shape}; this robot takes ({length},)")
    if not np.isfinite(values).all():
        index = int(np.flatnonzero(~np.isfinite(values))[0])
        raise ActionError(f"the action is not finite at index {index}")
    return values


def interpolate_targets(
    before: Floats, action: Floats, steps: int, seconds: float
) -> tuple[Floats, Floats]:
    """Rows (steps,A) that end at exactly `action`, and velocity (A,)."""
    share = np.arange(1, steps + 1)[:, None] / steps
    rows = before + share * (action - before)
    rows[-1] = action
    return rows, (action - before) / seconds


def pose_action_names(robot: Embodiment) -> tuple[str, ...]:
    """Names of the end-effector action (8S,): per arm a tool pose and the gripper value."""
    return tuple(f"{side}_{name}" for side in robot.sides for name in (*POSE_NAMES, "gripper"))


class ToolPoses:
    """Joint actions from end-effector actions (8S,), poses in the world."""

    def __init__(self, embodiment: Embodiment, budget: IkBudget = IK) -> None:
        self._planner: Planner = planner_of(embodiment)
        self._budget = budget

    def joints(
        self, action: Floats, command: Floats, tools: Floats | None = None, tip: Pose | None = None
    ) -> tuple[Floats, tuple[str, ...]]:
        """The joint action (A,) nearest to the command (A,), and the sides out of reach. With
        `tools` (S,7) poses are relative to these; they are of what carries its tool at `tip` (7,).
        Raises ActionError."""
        now, out, missed = self._planner.split(command), list[Floats](), list[str]()
        for i, side in enumerate(now):
            pose, gripper = action[8 * i : 8 * i + 7].copy(), action[8 * i + 7]
            length = np.linalg.norm(pose[3:])
            if length < 1e-6:
                raise ActionError(f"the quaternion of the {side} tool is zero")
            pose[3:] /= length
            pose = pose if tools is None else compose(tools[i], pose)
            pose = pose if tip is None else compose(pose, tip)
            chain, seed = self._planner.chains[side], now[side][0][None]
            q, reached = ik_many(chain, pose[None], seed, self._budget)
            if not reached[0]:
                missed.append(side)
            out.append(np.append(q[0] if reached[0] else now[side][0], gripper))
        return np.concatenate(out), tuple(missed)


class _PlannedArm(NamedTuple):
    base: Pose
    chain: Chain

    def poses(self, q: ArrayLike) -> Floats:
        return fk_batch(self.chain, q)


def codec_of(representation: Representation, embodiment: Embodiment) -> ActionCodec:
    chains = planner_of(embodiment).chains
    arms = {side: _PlannedArm(arm.base, chains[side]) for side, arm in embodiment.arms.items()}
    return ActionCodec(representation, embodiment.vector_names, arms)


EXACT = replace(IK, tolerance=(1e-6, 1e-5))  # of answers: the errors of delta actions add up


class Answers:
    """A policy's answers as joint targets; `unreachable` counts poses at which an arm holds
    still."""

    def __init__(self, representation: Representation, embodiment: Embodiment) -> None:
        self._tools = ToolPoses(embodiment, EXACT)
        self._codec = codec_of(representation, embodiment)
        self.length, self.unreachable = len(self._codec.names), 0

    def joints(self, chunk: Floats, state: Floats, command: Floats) -> Floats:
        """Joint targets (H,A) of a chunk (H,D), from measured joints and command (A,). Raises
        ActionError."""
        if not self._codec.representation.poses:
            return self._codec.decode_joints(chunk, state, command)
        try:
            poses, grippers = self._codec.decode_tools(chunk, state, command)
        except ValueError as error:
            raise ActionError(f"the action cannot be read: {error}") from error
        rows = np.concatenate([poses, grippers[..., None]], -1).reshape(len(chunk), -1)
        out = list[Floats]()
        for row in rows:
            command, missed = self._tools.joints(row, command)
            self.unreachable += len(missed)
            out.append(command)
        return np.stack(out)

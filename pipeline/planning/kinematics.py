"""Kinematics of one arm in the world frame, deterministic."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.joints import joints_to
from pipeline.poses import Bools, Floats, Pose, matrix
from pipeline.world.robots.contract import Arm

from . import ik_kernels
from .budgets import IK, LINE, IkBudget


@dataclass(frozen=True, eq=False)
class Chain:
    """The joints from the world to the tool frame as arrays for the kernels (see ik_kernels.py).

    `lower` and `upper` (n,) are the joint limits less the margin; `home` (n,); `reach` is (x, y, z,
    radius) of a ball around the first joint that contains every tool position; `restarts` (R,n) are
    joint vectors spread over the joint ranges."""

    pre: Floats
    prismatic: Bools
    tool: Floats
    lower: Floats
    upper: Floats
    home: Floats
    reach: Floats
    restarts: Floats

    @cached_property
    def kernel(self) -> tuple[Floats, Bools, Floats, Floats, Floats]:
        return self.pre, self.prismatic, self.tool, self.lower, self.upper


def chain_of(arm: Arm) -> Chain:
    """Chain from the world to `arm.tcp`. Raises ValueError when the joints between root link and
    hand are not exactly `arm.arm_joints` and fixed ones."""
    path = joints_to(arm.hand, arm.joints)
    moving = [joint for joint in path if joint.kind != "fixed"]
    if tuple(joint.name for joint in moving) != arm.arm_joints:
        names = [joint.name for joint in moving]
        raise ValueError(f"{arm.model}: joints to {arm.hand} are {names}, not {arm.arm_joints}")
    pre, carried = [], matrix(arm.base)
    for joint in path:
        carried = carried @ matrix(joint.origin)
        if joint.kind != "fixed":
            turn = z_onto(np.asarray(joint.axis, float))
            pre.append(carried @ turn)
            carried = turn.T
    tool = carried @ matrix(arm.tcp)
    lower = np.array([j.lower for j in moving]) + IK.limit_margin
    upper = np.array([j.upper for j in moving]) - IK.limit_margin
    prismatic = np.array([j.kind == "prismatic" for j in moving])
    links = sum(float(np.linalg.norm(m[:3, 3])) for m in (*pre[1:], tool))
    radius = links + float(np.sum(np.maximum(np.abs(lower), np.abs(upper))[prismatic]))
    return Chain(
        np.ascontiguousarray(np.stack(pre)[:, :3]),
        prismatic,
        np.ascontiguousarray(tool[:3]),
        lower,
        upper,
        np.array(arm.home, float),
        np.array([*pre[0][:3, 3], radius]),
        _spread(lower, upper, IK.stored_restarts),
    )


def fk(chain: Chain, q: ArrayLike) -> Pose:
    """World pose (7,) of the tool frame for joints q (n,)."""
    return fk_batch(chain, np.asarray(q, float)[None])[0]


def fk_batch(chain: Chain, q: ArrayLike) -> Floats:
    """World poses (N,7) of the tool frame for joints q (N,n)."""
    return ik_kernels.poses_of(chain.pre, chain.prismatic, chain.tool, _rows(q))


def ik_many(
    chain: Chain, targets: ArrayLike, seeds: ArrayLike, budget: IkBudget = IK
) -> tuple[Floats, Bools]:
    """Joints (N,n) within the limits, else zero, and success (N,) for world poses (N,7)."""
    return ik_kernels.solve_many(
        chain.kernel,
        chain.reach,
        _rows(targets),
        _rows(seeds).reshape(-1, len(chain.home)),
        chain.restarts[: budget.restarts],
        budget.iterations,
        budget.tolerance,
        -1 if budget.give_up_after is None else budget.give_up_after,
    )


def ik_path(chain: Chain, poses: ArrayLike, q0: ArrayLike) -> Floats | None:
    """Joints (K,n) along world poses (K,7) on one branch from `q0` (n,), or None."""
    rows = _rows(poses)
    start = np.clip(np.asarray(q0, float), chain.lower, chain.upper)
    q, reached = ik_kernels.solve_path(
        chain.kernel, rows, start, IK.path_iterations, IK.tolerance, IK.max_jump
    )
    return q if reached == len(rows) else None


def line_poses(start: Pose, goal: Pose) -> Floats:
    """Poses (K,7), K >= 2, from `start` to `goal`; rotation by slerp."""
    start, goal = np.asarray(start, float), np.asarray(goal, float)
    a, b = start[3:], goal[3:] if start[3:] @ goal[3:] >= 0 else -goal[3:]
    # a quarter of the rotation angle
    half = float(np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))
    steps = max(np.linalg.norm(goal[:3] - start[:3]) / LINE.step, 4 * half / LINE.turn)
    s = np.linspace(0.0, 1.0, 1 + max(1, int(np.ceil(steps - 1e-9))))[:, None]
    omega = 2 * half
    weights = 1 - s, s
    if omega >= 1e-9:
        weights = np.sin((1 - s) * omega) / np.sin(omega), np.sin(s * omega) / np.sin(omega)
    quats = weights[0] * a + weights[1] * b
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    return np.hstack([start[:3] + s * (goal[:3] - start[:3]), quats])


def limit_margin(chain: Chain, q: ArrayLike) -> Floats:
    """Distance to a joint limit as a share of the half range, (...,) for q (...,n)."""
    q = np.asarray(q, float)
    half = 0.5 * (chain.upper - chain.lower)
    return np.min(np.minimum(q - chain.lower, chain.upper - q) / half, axis=-1)


def _spread(lower: Floats, upper: Floats, count: int) -> Floats:
    """(count,n) evenly over a box: the recurrence R_n of Roberts (2018)."""
    n = len(lower)
    golden = 2.0
    for _ in range(40):
        golden = (1.0 + golden) ** (1.0 / (n + 1))
    unit = (0.5 + np.arange(count)[:, None] * golden ** -np.arange(1.0, n + 1)) % 1.0
    return lower + unit * (upper - lower)


def _rows(values: ArrayLike) -> Floats:
    return np.ascontiguousarray(np.atleast_2d(np.asarray(values, float)))


def z_onto(axis: Floats) -> Floats:
    """Rotation (4,4) whose z axis is `axis` in the old frame."""
    z = axis / np.linalg.norm(axis)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    out = np.eye(4)
    out[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    return out

"""Grasp candidates of a body, solved at once and ranked by cost."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.planning.failure import PlanFailure
from pipeline.planning.kinematics import limit_margin
from pipeline.planning.planner import ArmPlanner
from pipeline.poses import Bools, Floats, Pose, compose, inverse, pose, quat_about, quat_rotate
from pipeline.world.objects.contract import Grasp

from .actor import Actor
from .budgets import GRASP

_ROLLED = pose((0, 0, 0), quat_about((1, 0, 0), np.pi))  # the same pinch with the jaws exchanged


Goals = Sequence[ArrayLike]  # see GraspOptions


@dataclass(frozen=True)
class GraspOptions:
    """What a grasp is for: `kinds`, and `goals`, each (N,7) body poses of which the grasp must
    reach one. `standoff` (m) is the length of the line in, `pitch` (rad below the horizontal) the
    preferred approach, `steepest` the steepest. With `leading` > 0 only that many of the cheapest
    are looked at, one must lead to the goals, and the other hand may touch the body."""

    kinds: Sequence[str] | None = None
    goals: Goals = ()
    standoff: float = GRASP.standoff
    pitch: float = GRASP.pitch
    steepest: float = np.pi / 2
    leading: int = 0


@dataclass(frozen=True, eq=False)
class Candidates:
    """Grasps of a body, twice with the jaws exchanged: tcp poses (N,7) in body (`local`) and world
    (`tcp`), joints q (N,n), and in `order` those in reach, cheapest first."""

    grasps: list[Grasp]
    local: Floats
    tcp: Floats
    q: Floats
    order: list[int]
    opening: float


def backed_off(tcp: Pose, distance: float) -> Pose:
    """Tcp poses (...,7) drawn back along their approach axes by `distance` m."""
    return compose(tcp, pose((-distance, 0, 0)))


def hand_poses(actor: Actor, side: str, bodies: Floats) -> Floats:
    """Tcp poses (N,7) that put the held body at `bodies` (N,7)."""
    return compose(bodies, inverse(actor.in_hand(side))[None])


def near_one(directions: Floats, avoid: Sequence[Floats]) -> Bools:
    """Which directions (N,3) lie within GRASP.avoided of one of `avoid` (3,)."""
    near = [directions @ other > np.cos(GRASP.avoided) for other in avoid]
    return np.any(near, axis=0) & np.ones(len(directions), bool)


def find_candidates(
    arm: ArmPlanner,
    name: str,
    body: Pose,
    annotated: Sequence[Grasp],
    options: GraspOptions,
    avoid: Sequence[Floats],
) -> Candidates:
    """Rank the grasps that fit. Raises PlanFailure: no_grasp, grasp_unreachable."""
    grasps, local, opening = _fitting(arm, name, annotated, options)
    tcp = compose(body[None], local)
    q, ok = arm.solve(backed_off(tcp, options.standoff))
    if short := np.flatnonzero(~ok).tolist():
        near = backed_off(tcp[short], GRASP.short_share * options.standoff)
        q[short], ok[short] = arm.solve(near)
    x_axis = quat_rotate(tcp[:, 3:], np.array([1.0, 0.0, 0.0]))
    pitch = np.arcsin(np.clip(-x_axis[:, 2], -1, 1))
    ok &= pitch < options.steepest + 1e-6
    for goal in options.goals:
        ok &= _reaches_one(arm, local, np.asarray(goal), ok)
    if not ok.any():
        why = f"no grasp of {name} is in reach of the {arm.side} arm"
        raise PlanFailure("grasp_unreachable", why)
    room = np.minimum(limit_margin(arm.chain, q), GRASP.limit_margin)
    cost = np.linalg.norm(q - arm.q, axis=1) - GRASP.limit_weight * room
    cost += GRASP.lever_weight * np.linalg.norm(tcp[:, :2] - body[:2], axis=1)
    cost += GRASP.avoided_cost * near_one(x_axis, avoid)
    cost = np.where(ok, cost + GRASP.pitch_weight * np.abs(pitch - options.pitch), np.inf)
    order = np.argsort(cost, kind="stable")[: int(ok.sum())]
    return Candidates(grasps, local, tcp, q, order.tolist(), opening)


def leading_grasps(arm: ArmPlanner, name: str, annotated: Sequence[Grasp], goals: Goals) -> Floats:
    """Tcp poses (N,7) in the body frame that reach all `goals`."""
    local = _fitting(arm, name, annotated, GraspOptions())[1]
    ok = np.ones(len(local), bool)
    for goal in goals:
        ok &= _reaches_one(arm, local, np.asarray(goal), ok)
    return local[ok]


def _fitting(
    arm: ArmPlanner, name: str, annotated: Sequence[Grasp], options: GraspOptions
) -> tuple[list[Grasp], Floats, float]:
    """Grasps that fit between the jaws, their tcp poses (N,7), the largest width (m)."""
    opening = arm.planner.embodiment.arms[arm.side].gripper.opening - GRASP.spare_opening
    kinds = options.kinds
    fitting = (g for g in annotated if g.width <= opening)
    grasps = [g for g in fitting if kinds is None or g.kind in kinds]
    if not grasps:
        why = f"{name} offers no grasp of kind {kinds} under {opening:.3f} m"
        raise PlanFailure("no_grasp", why)
    poses = np.stack([g.pose for g in grasps])
    return grasps, np.hstack([poses, compose(poses, _ROLLED)]).reshape(-1, 7), opening


def _reaches_one(arm: ArmPlanner, local: Floats, bodies: Floats, alive: Bools) -> Bools:
    """Which grasps (N,) reach at least one of the body poses (G,7)."""
    out = np.zeros(len(local), bool)
    for body in bodies:
        todo = np.flatnonzero(alive & ~out)
        if len(todo) == 0:
            break
        out[todo] = arm.solve(compose(body[None], local[todo]))[1]
    return out

"""Choice of a grasp: all annotated candidates are solved at once, then the cheapest one that can be reached is taken."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from pipeline.expert.actor import Actor
from pipeline.expert.budgets import GRASP
from pipeline.planning.budgets import MARGINS
from pipeline.planning.failure import PlanFailure
from pipeline.planning.kinematics import limit_margin
from pipeline.planning.path import IsFree
from pipeline.planning.planner import ArmPlanner
from pipeline.planning.scene import Carried
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import Pose, compose, inverse, pose, quat_about, quat_rotate
from pipeline.world.objects.contract import Grasp

Floats = NDArray[np.float64]

_ROLLED = pose((0, 0, 0), quat_about((1, 0, 0), np.pi))  # the same pinch with the jaws exchanged


@dataclass(frozen=True)
class GraspOptions:
    """What a grasp is for.

    `kinds` restricts the candidates. Every entry of `goals` lists poses (7,) of the body of which the same grasp must be able to
    reach at least one later; one that gets there straight from above, touching nothing, is preferred. `standoff` (m) is the length
    of the straight line in. `pitch` (rad below the horizontal) is the approach preferred among equals.
    """

    kinds: Sequence[str] | None = None
    goals: Sequence[Sequence[Pose]] = ()
    standoff: float = GRASP.standoff
    pitch: float = GRASP.pitch


@dataclass(frozen=True, eq=False)
class GraspPlan:
    """The motion to a grasp: a free trajectory to the standoff, then a straight line (K,n), fingers open, to the tcp pose."""

    grasp: Grasp
    tcp: Pose
    to_standoff: ArmTrajectory
    line: Floats


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Grasps of a body, each counted twice: as annotated, and with the jaws exchanged (N in all).

    tcp poses (N,7) in the body frame (`local`) and in the world (`tcp`), joints q (N,n) at the standoffs, indices of the grasps in
    reach, cheapest first (`order`), and the largest width (m) that fits between the jaws.
    """

    grasps: list[Grasp]
    local: Floats
    tcp: Floats
    q: Floats
    order: list[int]
    opening: float


@dataclass(frozen=True, eq=False)
class _Checks:
    """Checkers with open jaws: along the line in, which ends in contact; at the standoff; along the line with room to others."""

    closing: IsFree
    standing: IsFree
    passing: IsFree


def lifted(p: Pose, height: float) -> Pose:
    """The same pose `height` m higher."""
    return p + np.array([0, 0, height, 0, 0, 0, 0])


def backed_off(tcp: Pose, distance: float) -> Pose:
    """The tcp pose drawn back along its approach axis by `distance` m."""
    return compose(tcp, pose((-distance, 0, 0)))


def hand_poses(actor: Actor, side: str, bodies: Floats) -> Floats:
    """Tcp poses (N,7) that put the held body at the poses `bodies` (N,7)."""
    return compose(bodies, inverse(actor.in_hand(side))[None])


def plan_grasp(actor: Actor, side: str, name: str, options: GraspOptions) -> GraspPlan:
    """Choose and plan a grasp of body `name` where it stands.

    Raises PlanFailure with reason no_grasp, grasp_unreachable or grasp_blocked.
    """
    return _plan(actor, actor.arm_planner(side), name, actor.pose(name), options)


def can_take_over(actor: Actor, side: str, giver: str, q: Floats, options: GraspOptions) -> bool:
    """Whether arm `side` finds a grasp of what arm `giver` holds once that one has joints q (n,)."""
    arm, name = actor.arm_planner(side), actor.held[giver]
    body = compose(actor.planner.fk(giver, q), actor.in_hand(giver))
    try:
        _plan(actor, arm.within(arm.scene.expecting(giver, q)), name, body, options)
    except PlanFailure:
        return False
    return True


def _plan(actor: Actor, arm: ArmPlanner, name: str, body: Pose, options: GraspOptions) -> GraspPlan:
    """A grasp of body `name` at the pose `body` (7,) in the scene of `arm`; see `plan_grasp`."""
    side = arm.side
    found = _candidates(arm, name, body, actor.frames(name).grasps, options)
    checks = _checks(arm, name)
    blocked = "grasp_unreachable"
    tries = GRASP.tries
    spare = list[tuple[int, Floats]]()

    def preferred() -> Iterator[tuple[int, Floats]]:
        """Candidates that can be taken, cheapest first, with the line in. `spare` keeps those that pass too near to other bodies or
        from which no goal is sure to be reached."""
        nonlocal blocked
        for i in found.order:
            line = arm.line(found.q[i], found.tcp[i])
            if line is None or arm.line(line[-1], lifted(found.tcp[i], GRASP.lift)) is None:
                continue
            blocked = "grasp_blocked"
            if not (checks.closing(line) and checks.standing(found.q[i])):
                continue
            held = Carried(side, actor.collision(name), inverse(found.local[i]))
            jaws = min(1.0, found.grasps[i // 2].width / found.opening)
            if (
                len(spare) < tries
                and checks.passing(line)
                and all(_leads_to(arm, name, held, line[-1], jaws, np.asarray(goal)) for goal in options.goals)
            ):
                yield i, line
            else:
                spare.append((i, line))

    for i, line in chain(preferred(), spare):
        tries -= 1
        try:
            return GraspPlan(found.grasps[i // 2], found.tcp[i], arm.free_trajectory(found.q[i], checks.standing), line)
        except PlanFailure:
            if tries <= 0:
                break
    raise PlanFailure(blocked, f"no grasp of {name} can be reached by the {side} arm without touching something")


def _candidates(arm: ArmPlanner, name: str, body: Pose, annotated: Sequence[Grasp], options: GraspOptions) -> _Candidates:
    """All grasps of a body that fit between the jaws. Raises PlanFailure("no_grasp") and PlanFailure("grasp_unreachable")."""
    opening = arm.planner.embodiment.arms[arm.side].gripper.max_opening - GRASP.spare_opening
    grasps = [g for g in annotated if g.width <= opening and (options.kinds is None or g.kind in options.kinds)]
    if not grasps:
        raise PlanFailure("no_grasp", f"{name} offers no grasp of kind {options.kinds} under {opening:.3f} m")
    local = np.stack([p for g in grasps for p in (g.pose, compose(g.pose, _ROLLED))])
    tcp = compose(body[None], local)
    q, ok = arm.solve(np.stack([backed_off(t, options.standoff) for t in tcp]))
    for goal in options.goals:
        ok &= _reaches_one(arm, local, np.asarray(goal), ok)
    if not ok.any():
        raise PlanFailure("grasp_unreachable", f"no grasp of {name} is in reach of the {arm.side} arm")
    x_axis = quat_rotate(tcp[:, 3:], np.array([1.0, 0.0, 0.0]))
    pitch = np.arcsin(np.clip(-x_axis[:, 2], -1, 1))
    room = np.minimum(limit_margin(arm.chain, q), GRASP.limit_margin)
    cost = np.linalg.norm(q - arm.q, axis=1) - GRASP.limit_weight * room
    cost = np.where(ok, cost + GRASP.pitch_weight * np.abs(pitch - options.pitch), np.inf)
    order = np.argsort(cost, kind="stable")[: int(ok.sum())]
    return _Candidates(grasps, local, tcp, q, order.tolist(), opening)


def _checks(arm: ArmPlanner, name: str) -> _Checks:
    near = [(arm.side, other) for other in ("table", name) if other == "table" or other in arm.scene.obstacles]
    return _Checks(
        closing=arm.checker(jaws=1.0, margin=MARGINS.contact),
        standing=arm.checker(jaws=1.0),
        passing=arm.checker(near, jaws=1.0, margin=GRASP.passing),
    )


def _reaches_one(arm: ArmPlanner, local: Floats, bodies: Floats, alive: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which grasps (N,) reach at least one of the body poses (G,7); only those still alive are solved."""
    out = np.zeros(len(local), bool)
    for body in bodies:
        todo = np.flatnonzero(alive & ~out)
        if len(todo) == 0:
            break
        out[todo] = arm.solve(compose(body[None], local[todo]))[1]
    return out


def _leads_to(arm: ArmPlanner, name: str, carried: Carried, q: Floats, jaws: float, bodies: Floats) -> bool:
    """Whether body `name`, carried like this from joints q (n,) on, gets to one of its poses (G,7) straight from above.

    No part of the arm may touch anything there; `jaws` is the gripper value.
    """
    holding = arm.within(arm.scene.holding(name, carried))
    others = [(name, other) for other in (*holding.scene.obstacles, "table")]
    free = holding.checker(others, jaws=jaws, margin=MARGINS.contact)
    hands, seeds = compose(bodies, inverse(carried.pose)[None]), np.stack([q, arm.home])
    for some in np.split(hands, range(GRASP.goal_batch, len(hands), GRASP.goal_batch)):
        at, ok = arm.solve_from(some, seeds)
        for k in np.flatnonzero(ok):
            if free(at[k]) and arm.line(at[k], lifted(some[k], GRASP.above_goal)) is not None:
                return True
    return False

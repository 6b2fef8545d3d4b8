"""Choice of a grasp: all candidates are solved at once."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain

import numpy as np

from pipeline.planning.budgets import MARGINS
from pipeline.planning.collision import Carried
from pipeline.planning.failure import PlanFailure
from pipeline.planning.path import IsFree, ending_clear
from pipeline.planning.planner import ArmPlanner
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import Floats, Pose, compose, inverse, lifted, quat_rotate
from pipeline.world.objects.contract import Grasp
from pipeline.world.shapes import Collider

from .actor import Actor
from .budgets import GRASP, HAND_OVER
from .candidates import Candidates, Goals, GraspOptions, backed_off, find_candidates


@dataclass(frozen=True, eq=False)
class GraspPlan:
    """The motion to the standoff, then a straight line (K,n) to the grasp."""

    grasp: Grasp
    jaws: float
    tcp: Pose
    to_standoff: ArmTrajectory
    line: Floats

    @property
    def approach(self) -> Floats:
        """Direction (3,) of the line in, in the world."""
        return quat_rotate(self.tcp[3:], np.array([1.0, 0.0, 0.0]))


@dataclass(frozen=True, eq=False)
class _Checks:
    closing: IsFree
    standing: IsFree
    passing: IsFree


@dataclass(frozen=True, eq=False)
class GraspChoice:
    """The candidates of one body in one scene. `parts` tells whether a hand that holds the body can
    open and draw back from joints (n,)."""

    arm: ArmPlanner
    name: str
    pieces: tuple[Collider, ...]
    found: Candidates
    checks: Callable[[float], _Checks]
    goals: Goals
    parts: Callable[[Floats, float], bool]

    def lines(self) -> dict[int, Floats]:
        """By candidate, cheapest first: joints (K,n) straight in from the standoff."""
        lines = dict[int, Floats]()
        for i in self.found.order:
            line = self.arm.line(self.found.q[i], self.found.tcp[i])
            if line is not None and self.risen(i, line) is not None:
                lines[i] = line
        return lines

    def risen(self, i: int, line: Floats) -> Floats | None:
        """Joints (n,) when the hand has risen straight up from the grasp, or None."""
        path = self.arm.line(line[-1], lifted(self.found.tcp[i], GRASP.lift))
        return None if path is None else path[-1]

    def free(self, i: int, line: Floats, jaws: float) -> bool:
        """Whether the jaws are wide enough and the hand touches nothing from the standoff on."""
        room = jaws * (self.found.opening + GRASP.spare_opening) - GRASP.spare_opening
        checks = self.checks(jaws)
        return (
            self.found.grasps[i // 2].width <= room
            and checks.closing(line)
            and checks.standing(self.found.q[i])
            and self.parts(line[-1], self._closed(i))
        )

    def _closed(self, i: int) -> float:
        return min(1.0, self.found.grasps[i // 2].width / self.found.opening)

    def leads_on(self, i: int, line: Floats, jaws: float) -> bool:
        """Whether the line of candidate i is free and leads to every goal."""
        passing, risen = self.checks(jaws).passing, self.risen(i, line)
        if risen is None or not passing(line) or not passing(risen):
            return False
        held = Carried(self.arm.side, self.pieces, inverse(self.found.local[i]))
        closed = self._closed(i)
        return all(
            _leads_to(self.arm, self.name, held, line[-1], closed, np.asarray(goal))
            for goal in self.goals
        )

    def promising(self) -> bool:
        """Whether one of the GRASP.tries cheapest candidates leads to the goals."""
        tries = GRASP.tries
        lines = self.lines()
        for jaws in GRASP.openings:
            for i, line in lines.items():
                if not self.free(i, line, jaws):
                    continue
                if self.leads_on(i, line, jaws):
                    return True
                tries -= 1
                if tries == 0:
                    return False
        return False


def search_of(
    actor: Actor, arm: ArmPlanner, name: str, at: Pose, options: GraspOptions
) -> GraspChoice:
    """Grasps of the body at world pose `at`. Raises PlanFailure: no_grasp, grasp_unreachable."""
    found = find_candidates(
        arm, name, at, actor.frames(name).grasps, options, actor.avoid.get(name, [])
    )
    touched = [name] if options.leading or name in arm.scene.obstacles else []
    near = [(arm.side, "table"), *((f"{arm.side}_fingers", other) for other in touched)]
    hands = MARGINS.hands if name in arm.scene.carried else MARGINS.arms
    checks = cache(partial(_checks, arm, near, hands))
    return GraspChoice(
        arm, name, actor.collision(name), found, checks, options.goals, _parting(arm, name)
    )


def _parting(arm: ArmPlanner, name: str) -> Callable[[Floats, float], bool]:
    held = arm.scene.carried.get(name)
    if held is None or held.side == arm.side:
        return lambda q, jaws: True
    giver = ArmPlanner(arm.planner, held.side, arm.scene, arm.rng)
    there = arm.scene.arms[held.side].expected
    back = giver.line(there, backed_off(giver.fk(there), HAND_OVER.draw_back))
    rows = there[None] if back is None else back
    hands = arm.planner.world.between_arms({}, MARGINS.hands)
    if arm.side == "left":
        return lambda q, jaws: hands.first_blocked(q, rows, (jaws, 1.0)) is None
    return lambda q, jaws: hands.first_blocked(rows, q, (1.0, jaws)) is None


def plan_grasp(actor: Actor, side: str, name: str, options: GraspOptions) -> GraspPlan:
    """Plan a grasp of body `name` where it is. Raises PlanFailure: grasp_blocked too."""
    return _plan(actor, actor.arm_planner(side), name, actor.pose(name), options)


def can_take_over(actor: Actor, side: str, giver: str, q: Floats, options: GraspOptions) -> bool:
    """Whether `side` finds a grasp if `giver` has joints q (n,)."""
    arm, name = actor.arm_planner(side), actor.held[giver]
    body = compose(actor.planner.fk(giver, q), actor.in_hand(giver))
    try:
        _plan(actor, arm.within(arm.scene.expecting(giver, q)), name, body, options)
    except PlanFailure:
        return False
    return True


def _plan(actor: Actor, arm: ArmPlanner, name: str, body: Pose, options: GraspOptions) -> GraspPlan:
    search = search_of(actor, arm, name, body, options)
    found, lines = search.found, search.lines()
    tries, judged = GRASP.tries, options.leading or GRASP.tries
    spare = list[tuple[int, Floats, float]]()

    def preferred() -> Iterator[tuple[int, Floats, float]]:
        """Feasible candidates, cheapest first, with the line in and the gripper value."""
        for jaws in GRASP.openings:
            for i, line in lines.items():
                if not search.free(i, line, jaws):
                    continue
                if len(spare) < judged and search.leads_on(i, line, jaws):
                    yield i, line, jaws
                else:
                    spare.append((i, line, jaws))

    for i, line, jaws in chain(preferred(), () if options.leading else spare):
        tries -= 1
        try:
            to_standoff = arm.free_trajectory(found.q[i], search.checks(jaws).standing)
        except PlanFailure:
            if tries <= 0:
                break
        else:
            table = arm.bare().checker(jaws=jaws, hands=MARGINS.hands)
            ending = ending_clear(line, table, 1 - GRASP.short / options.standoff)
            last = line if ending is None else ending
            return GraspPlan(found.grasps[i // 2], jaws, found.tcp[i], to_standoff, last)
    why = f"the {arm.side} arm reaches no grasp of {name} without touching something"
    raise PlanFailure("grasp_blocked" if lines else "grasp_unreachable", why)


def _checks(arm: ArmPlanner, near: Sequence[tuple[str, str]], hands: float, jaws: float) -> _Checks:
    """`near` pairs need no room; `hands` (m) is the gap between hands."""
    return _Checks(
        closing=arm.checker(jaws=jaws, margin=MARGINS.contact, hands=hands),
        standing=arm.checker(jaws=jaws),
        passing=arm.checker(near, jaws=jaws, margin=GRASP.passing, hands=hands),
    )


def _leads_to(
    arm: ArmPlanner, name: str, carried: Carried, q: Floats, jaws: float, bodies: Floats
) -> bool:
    """Whether the body, carried from joints q (n,), gets down to one of its poses (G,7)."""
    holding = arm.within(arm.scene.holding(name, carried))
    others = [(name, other) for other in (*holding.scene.obstacles, "table")]
    free = holding.checker(others, jaws=jaws, margin=MARGINS.contact)
    hands, seeds = compose(bodies, inverse(carried.pose)[None]), np.stack([q, arm.chain.home])
    for some in np.split(hands, range(GRASP.goal_batch, len(hands), GRASP.goal_batch)):
        at, ok = arm.solve(some, seeds)
        for k in np.flatnonzero(ok):
            if free(at[k]) and arm.line(at[k], lifted(some[k], GRASP.above_goal)) is not None:
                return True
    return False

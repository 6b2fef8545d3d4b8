"""A plan for a still target, carried along with a moving one."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.expert.limiter import LAG, Limiter
from pipeline.planning.budgets import IkBudget
from pipeline.planning.kinematics import ik_many
from pipeline.planning.path import IsFree
from pipeline.planning.planner import Planner
from pipeline.poses import Floats, Pose, compose, inverse, quat_about, quat_conjugate, quat_multiply

from .imagination import PACE, MeetingPlan
from .prediction import TargetFilter

Command = tuple[Floats, Floats]  # drive targets (A,) of a physics step and their velocities

CONTROL_HZ = 15  # how often it looks at the target and corrects its commands
PERIOD = PHYSICS_HZ // CONTROL_HZ  # physics steps of one correction

CLOSE, FUNNEL = 0.004, 0.02
"""Distance (m) of the hand from its place relative to the target, beyond which it goes no nearer:
at the end of its way, and what is added at the beginning."""
EXPECTED = 0.004  # m of the target from where it was expected, beyond which the hand waits
EASY = 0.7  # share of these distances up to which the hand keeps the plan's pace

CHANGE, BACK = 0.5, 0.25
"""Greatest change of the pace in a control period, and the pace of drawing back, as shares of the
plan's: a hand that turns at once overshoots."""

STARTLED = 2.0  # times EXPECTED, from which a hand turns at once at the plan's pace
UNSURE = 3.0  # standard deviations of the sight by which both may be larger
AT_REST = 1e-4  # rad/s or m/s of commands that count as none

PATIENCE, BEYOND = 1.6, 0.3
"""Seconds near the target for which the hand may go no nearer, and may be unable to follow."""
LINGER = 4  # control periods at the plan's end in which a hand that touched nothing may catch up

SAME_BRANCH = IkBudget(restarts=0)


class ReactiveExpert:
    """Commands for one control period after another, from what was seen of the target so far.

    On the plan's last skill it follows the moving target. The hands approach only while both are
    where expected; else they slow down, then retreat.
    """

    def __init__(self, planner: Planner, command: Floats) -> None:
        self._planner = planner
        self.limiter = Limiter(command, *planner.command_limits())
        self.stalled, self.beyond, self.ended = 0, 0, 0
        """Control periods near the target without going nearer, the last ones in a row without
        following it, and those at the end of the plan."""

    def follow(self, plan: MeetingPlan, bars: Sequence[tuple[IsFree, IsFree]] = ()) -> None:
        """Begin the last skill of a plan. The hand waits if the target leads it to a command that
        fails the first test of one of `bars` and the plan passes the second.
        """
        self._bars = bars
        self.plan, self.row = plan, float(plan.last)
        self.stalled, self.beyond, self.ended = 0, 0, 0
        self._shift = {side: np.zeros_like(self._planner.home(side)) for side in plan.sides}
        self._error, self._touched, self._pace, self._startled = 0.0, False, 1.0, False

    @property
    def done(self) -> bool:
        return self.ended > (0 if self._touched else LINGER)

    @property
    def hindered(self) -> bool:
        """Whether the plan does not lead to the target as it moves."""
        return self.stalled > PATIENCE * CONTROL_HZ or self.beyond > BEYOND * CONTROL_HZ

    @property
    def near(self) -> bool:
        """Whether the hand moves as the target does."""
        return self.row >= self.plan.near

    def act(self, track: TargetFilter, time: float, *, touched: bool = False) -> Iterator[Command]:
        """Commands of a control period from `time` (s) on; not all need be taken."""
        if touched or not self.near:
            self._pace, self._startled = 1.0, False
        else:
            self._choose_pace(*self._excess(track))
        first, last = self.row, self.plan.near
        if self.near:
            first, last = self.plan.near, len(self.plan.commands) - 1
        end = float(np.clip(self.row + PACE * self._pace * PERIOD, first, last))
        self.ended += end >= len(self.plan.commands) - 1
        if not touched:
            self._target = track.predict(time + PERIOD / PHYSICS_HZ + LAG)
        elif not self._touched:
            self._target, self._touched = track.predict(time), True
        return self._move(end)

    def _choose_pace(self, astray: float, surprise: float) -> None:
        excess = max(astray, surprise)
        self.stalled += excess >= 1.0
        self._startled = surprise >= STARTLED or (self._startled and astray >= 1.0)
        pace = float(np.clip((1.0 - excess) / (1.0 - EASY), -1.0 if self._startled else -BACK, 1.0))
        if surprise < 1.0 and not self._startled:
            pace = float(np.clip(pace, self._pace - CHANGE, self._pace + CHANGE))
        self._pace = pace

    def _excess(self, track: TargetFilter) -> tuple[float, float]:
        """Errors of hand and target as multiples of what is allowed."""
        left = max(0.0, self.plan.met - self.row) / max(1, self.plan.met - self.plan.near)
        unsure = UNSURE * track.noise
        astray = self._error / (CLOSE + FUNNEL * left + unsure)
        return max(astray, 1.0) if self.beyond else astray, track.surprise / (EXPECTED + unsure)

    def back(self, track: TargetFilter, time: float) -> Iterator[Command]:
        """Go back to where the hand was first near the target; commands as of `act`."""
        self._target = track.predict(time + PERIOD / PHYSICS_HZ + LAG)
        return self._move(max(self.row - PACE * PERIOD, min(self.row, self.plan.near)))

    def rest(self) -> Iterator[Command]:
        """Commands that come to rest as soon as the limits allow."""
        stop = self.limiter.stop
        return (self._command(stop, np.zeros_like(stop)) for _ in range(PERIOD))

    @property
    def moving(self) -> bool:
        return bool(np.abs(self._velocity).max() > AT_REST)

    def _move(self, end: float) -> Iterator[Command]:
        start, before, (after, lost) = self.row, self._shift, self._shifts(self._target, end)
        barred = end >= start and not self._touched and self._leads_astray(end, after)
        if barred:
            end, after = start, before
        self.beyond = self.beyond + 1 if barred or (lost and self.near) else 0
        last = self._goal(start, before)
        for share in np.linspace(0.0, 1.0, PERIOD + 1)[1:]:
            self.row = float(start + share * (end - start))
            self._shift = {
                side: before[side] + share * (after[side] - before[side]) for side in after
            }
            goal = self._goal(self.row, self._shift)
            command = self._command(goal, (goal - last) * PHYSICS_HZ)
            last = goal
            if share == 1.0:
                self._error = max([0.0, *(self._off(side, goal) for side in after)])
            yield command

    def command_at(self, row: float, target: Pose) -> Floats:
        """The command (A,) at a row of the plan for a target at `target` (7,), without limits."""
        self._shift, _ = self._shifts(target, row)
        return self._goal(row, self._shift)

    def _leads_astray(self, row: float, shift: Mapping[str, Floats]) -> bool:
        goal, planned = self._goal(row, shift), _at(self.plan.commands, row)
        return any(not free(goal) and clear(planned) for free, clear in self._bars)

    def _goal(self, row: float, shift: Mapping[str, Floats]) -> Floats:
        """The command (A,) at a row of the plan with the joints off it by `shift`."""
        goal, start = _at(self.plan.commands, row), 0
        for side in self._planner.embodiment.sides:
            n = len(self._planner.home(side))
            goal[start : start + n] += shift.get(side, 0.0)
            start += n + 1
        return goal

    def _command(self, goal: Floats, velocity: Floats) -> Command:
        command, self._velocity = self.limiter.follow(goal, velocity)
        return command, self._velocity

    def _off(self, side: str, goal: Floats) -> float:
        """Distance (m) of the hand from where joints `goal` (A,) have it."""
        there, here = (
            self._planner.fk(side, self._planner.split(q)[side][0]) for q in (goal, self.limiter.at)
        )
        return float(np.linalg.norm(there[:3] - here[:3]))

    def _shifts(self, target: Pose, row: float) -> tuple[dict[str, Floats], bool]:
        """Joint offsets (n,) by side that move the hand as the target moved, and whether an arm is
        out of reach.
        """
        span = max(1.0, self.plan.near - self.plan.last)
        x = float(np.clip((row - self.plan.last) / span, 0.0, 1.0))
        if self.plan.is_round:
            target = turned_like(target, self.plan.aim)
        moved = part_of(self.plan.aim, target, x * x * (3 - 2 * x))
        planned, lost = self._planner.split(_at(self.plan.commands, row)), False
        found = dict[str, Floats]()
        for side, shift in self._shift.items():
            q = planned[side][0]
            goal = compose(moved, self._planner.fk(side, q))
            solved, ok = ik_many(
                self._planner.chains[side], goal[None], (q + shift)[None], SAME_BRANCH
            )
            lost |= not ok[0]
            found[side] = solved[0] - q if ok[0] else shift
        return found, lost


def turned_like(body: Pose, other: Pose) -> Pose:
    """The pose (7,) of a round body turned about its own z axis to be nearest to the other's."""
    w, _, _, z = quat_multiply(quat_conjugate(body[3:]), other[3:])
    turn = quat_about((0.0, 0.0, 1.0), 2 * np.arctan2(z, w))
    return np.concatenate([body[:3], quat_multiply(body[3:], turn)])


def part_of(start: Pose, end: Pose, share: float) -> Pose:
    """The world displacement (7,) by `share` of the way from start to end."""
    turn = quat_multiply(end[3:], quat_conjugate(start[3:]))
    turn = turn if turn[0] >= 0 else -turn
    sine = float(np.linalg.norm(turn[1:]))
    part = (
        quat_about(turn[1:], 2 * share * np.arctan2(sine, turn[0]))
        if sine > 1e-9
        else np.array([1.0, 0.0, 0.0, 0.0])
    )
    between = np.concatenate(
        [start[:3] + share * (end[:3] - start[:3]), quat_multiply(part, start[3:])]
    )
    return compose(between, inverse(start))


def _at(commands: Floats, row: float) -> Floats:
    """The command (A,) at a fractional row."""
    low = min(int(row), len(commands) - 1)
    return commands[low] + (row - low) * (commands[min(low + 1, len(commands) - 1)] - commands[low])

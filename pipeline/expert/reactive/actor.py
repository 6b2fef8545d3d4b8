"""The reactive expert in one running simulation."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.names import SIDES
from pipeline.data.setup.rules import Sight
from pipeline.expert.actor import Actor
from pipeline.motion.workspace import Workspace
from pipeline.motion.wrapped import Rider, others_of
from pipeline.planning.failure import PlanFailure
from pipeline.planning.path import IsFree
from pipeline.planning.planner import NO_ARM
from pipeline.poses import Floats, Pose, compose, inverse
from pipeline.world.physics.body import Body
from pipeline.world.physics.events import in_roles

from .controller import CONTROL_HZ, PERIOD, Command, ReactiveExpert
from .imagination import PACE, MeetingPlan, Script, imagine
from .prediction import TargetFilter

OBSERVED = 1 / CONTROL_HZ  # s for which it only looks, to see the target twice; plus the delay

GUESSES = ((2.0, 0.0), (1.0, 0.0), (0.0, 0.0), (2.0, 0.5), (1.0, 0.9))
"""Where it tries to meet the target: seconds from now, and the share of the way from there to the
place that suits the arm. The hand follows the target, so a plan nearby will do."""

ASIDE = 0.17  # m of the place that suits an arm from the middle of the workspace

FAR = 0.03  # m between a plan's aim and the expected target, beyond which it plans again
ELSEWHERE = 0.15  # the same for a hand on its way

WAITING = 0.4  # s until it plans again where no plan was found
RENEWED = 0.5  # s between two plans of a hand on its way, at least

KEPT = 2.0  # s, time constant with which a target, which may turn, is expected to slow down

GAPS = (((0.0, 0.006), (0.0, 0.012)), ((0.008, 0.006), (0.012, 0.012)))
"""Pairs of gaps (m) to the table and bodies, and between the hands: the target does not lead the
arms below the first two where the plan keeps the last two. Commands overshoot by some mm."""

GONE = 0.05  # m from its workspace at which the target is given up

ROUNDS = 8  # of planning, waiting in between, before it gives up
TRIES = 5  # to touch the target


class Attended(Protocol):
    """What the expert knows of a task: where the target moves, and which arm has which role."""

    workspace: ClassVar[Workspace]

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]: ...


class ReactiveActor(Actor):
    """An expert that sees the target's poses up to now; call `attend` first. `believed` poses (7,)
    replace measured ones.
    """

    def attend(self, sight: Sight, task: Attended, rng: np.random.Generator) -> None:
        """Begin to look at the target of a task; `rng` draws the errors of sight."""
        self.sight, self.workspace, self._sight_rng = sight, task.workspace, rng
        self._roles, self._task = self.simulation.roles, task
        self._see_anew()
        self._look()

    def _see_anew(self) -> None:
        shape = self.bodies[self.simulation.target].instance.shape()
        ball = all(piece.kind == "sphere" for piece in shape.collision)
        self.track = TargetFilter(self.sight.noise, shape.aabb().mean(axis=0), ball=ball)
        self.believed = dict[str, Pose]()
        self._late = list[tuple[float, Pose]]()

    def _take_roles(self) -> None:
        """Turn to the body that an event made the target."""
        self._roles = self.simulation.roles
        self.bodies = in_roles(self.bodies, self._roles)
        self.arms, self._frames = self._task.arms(self.bodies), {}
        self._see_anew()

    def pose(self, name: str) -> Pose:
        """World pose (7,) of a body, measured or believed."""
        believed = getattr(self, "believed", {})
        return believed[name].copy() if name in believed else super().pose(name)

    def advance(self, command: Floats, velocity: Floats) -> None:
        """One physics step; looks at the target each control period."""
        super().advance(command, velocity)
        if self.simulation.steps % PERIOD == 0:
            self._look()

    def _look(self) -> None:
        if self._roles is not self.simulation.roles:
            self._take_roles()
        now, seen = self.simulation.time, self.simulation.pose(self.simulation.target)
        hidden = self.is_hidden(seen[:3])
        seen[:3] += self._sight_rng.normal(0.0, 1.0, 3) * self.sight.noise
        if not hidden:
            self._late.append((now, seen))
        while self._late and self._late[0][0] <= now - self.sight.delay + 1e-9:
            self.track.see(*self._late.pop(0))

    def is_hidden(self, point: Floats) -> bool:
        """Whether an event hides a world point (3,) now."""
        script = self.simulation.script
        return script is not None and script.hides(point, self.simulation.time)

    @property
    def _carried(self) -> list[str]:
        """What moves with the target, on the same belt or disc."""
        if self.simulation.released:
            return []
        others = others_of(self.simulation.motion)
        return [name for name, motion in others.items() if isinstance(motion, Rider)]

    @property
    def watched_for(self) -> float:
        """Seconds from the start after which it has seen the target twice."""
        return OBSERVED + self.sight.delay

    def meet(self, script: Script, *, rest: bool = False) -> None:
        """Carry out the script's first half until the target is touched; with `rest`, its last
        skill. Raises PlanFailure.
        """
        self._hold(max(0.0, self.watched_for - self.simulation.time))
        plan = self.plan(script, rest=rest)
        expert: ReactiveExpert | None = None
        for _ in range(TRIES):
            if plan.last:
                plan = self._prepare(plan, script)
            expert = expert or ReactiveExpert(self.planner, self.simulation.command)
            if met := self._follow(expert, plan, script):
                self.held, self.approaches = dict(met.held), dict(met.approaches)
                return
            plan = self.plan(script, rest=True)
        raise PlanFailure(
            "missed", f"nothing touched the {self.simulation.target} in {TRIES} tries"
        )

    def _prepare(self, plan: MeetingPlan, script: Script) -> MeetingPlan:
        began, roles = self.simulation.steps, self._roles
        for row in range(plan.last):
            self.advance(plan.commands[row], plan.velocities[row])
            self._refuse_touch()
        self._note(plan, [(0, began), (plan.last, self.simulation.steps)])
        self._hold(0.0)
        self.held = dict(plan.holding)
        if self._roles is not roles:
            return self.plan(script, rest=True)
        return self._newer(script) or plan

    def _newer(self, script: Script) -> MeetingPlan | None:
        try:
            plan = self.plan(script, rest=True, rounds=1)
        except PlanFailure:
            return None
        return None if plan.last else plan

    def _hold(self, seconds: float) -> None:
        until = self.simulation.steps + round(seconds * PHYSICS_HZ)
        self.wait(-(-until // PERIOD) * PERIOD / PHYSICS_HZ - self.simulation.time)

    def _refuse_touch(self) -> None:
        if by := self.simulation.touched_by:
            raise PlanFailure("early_meeting", f"{by} touched the target too soon")

    def plan(self, script: Script, *, rest: bool, rounds: int = ROUNDS) -> MeetingPlan:
        """A plan that meets the target where it is expected; waits between rounds. Raises
        PlanFailure.
        """
        why = ("missed", "nothing was planned")
        for n in range(rounds):
            if n:
                self._hold(WAITING)
                self._refuse_touch()
            if not np.isfinite(self.track.time):
                self._hold(self.watched_for)
            if not self.workspace.contains(self.track.predict(self.simulation.time), -GONE):
                raise PlanFailure("missed", f"the {self.simulation.target} has left its workspace")
            for seconds, share in GUESSES:
                try:
                    plan = self._imagine(script, self._expected(seconds, share), rest=rest)
                except PlanFailure as failed:
                    why = failed.reason, failed.detail
                    continue
                if (
                    plan.last
                    or np.linalg.norm(self._expected(plan.seconds)[:3] - plan.aim[:3]) < FAR
                ):
                    return plan
                with suppress(PlanFailure):
                    return self._imagine(script, self._expected(plan.seconds), rest=rest)
                return plan
        raise PlanFailure(*why)

    def _expected(self, seconds: float, share: float = 0.0) -> Pose:
        ahead = KEPT * (1.0 - np.exp(-seconds / KEPT))
        pose, space = self.track.predict(self.simulation.time + ahead), self.workspace
        inside = np.clip(pose[:2], space.lower, space.upper)
        aside = -ASIDE if next(iter(self.arms.values())) == "left" else ASIDE
        suits = 0.5 * (space.lower + space.upper) + np.array([aside, 0.0])
        pose[:2] = inside + share * (suits - inside)
        return pose

    def _imagine(self, script: Script, aim: Pose, *, rest: bool) -> MeetingPlan:
        target, measured = self.simulation.target, self.simulation.pose
        riders = [name for name, body in self.bodies.items() if body.inside == target]
        riders += self._carried
        self.believed = {target: aim} | {
            n: compose(aim, compose(inverse(measured(target)), measured(n))) for n in riders
        }
        try:
            return imagine(self, script, aim, rest=rest)
        finally:
            self.believed = {}

    def _follow(
        self, expert: ReactiveExpert, plan: MeetingPlan, script: Script
    ) -> MeetingPlan | None:
        """Execute the last skill of a plan, or of a newer one; None if the target was not touched.
        Raises PlanFailure("early_meeting").
        """
        bars = [(self._checker(*near), self._checker(*planned)) for near, planned in GAPS]
        expert.follow(plan, bars)
        passed, renew = [(expert.row, self.simulation.steps)], self.simulation.time + RENEWED
        roles = self._roles
        while (
            not expert.done
            and self._roles is roles
            and (self.simulation.released or not expert.hindered)
        ):
            if not expert.near and self.simulation.time >= renew:
                renew = self.simulation.time + RENEWED
                left = (plan.met - expert.row) / (PACE * PHYSICS_HZ)
                if np.linalg.norm(self._expected(left)[:2] - plan.aim[:2]) > ELSEWHERE and (
                    newer := self._newer(script)
                ):
                    self._note(plan, passed)
                    plan = newer
                    expert.follow(plan, bars)
                    passed = [(expert.row, self.simulation.steps)]
            self._run(
                expert.act(self.track, self.simulation.time, touched=self.simulation.released)
            )
            if not expert.near and self.simulation.touched_by not in self.held.values():
                self._refuse_touch()
            passed.append((expert.row, self.simulation.steps))
        met = bool(self.simulation.touched_by)
        while not met and self._roles is roles and expert.row > plan.near:
            self._run(expert.back(self.track, self.simulation.time))
            self._refuse_touch()
        while expert.moving:
            self._run(expert.rest())
        self._note(plan, passed)
        return plan if met else None

    def _checker(self, margin: float, hands: float) -> IsFree:
        """A test whether commands (A,) keep hands and arms apart (m)."""
        now = self.planning_scene()
        moving = {self.simulation.target, *self._carried}
        others = {name: o for name, o in now.obstacles.items() if name not in moving}
        held = [(name, other) for name in now.carried for other in (*others, "table", "furniture")]
        scene = self.planner.world.with_objects(
            others, now.carried, ignore=held, margin=margin, hands=hands
        )

        def free(command: ArrayLike) -> bool:
            now = self.planner.split(np.asarray(command))
            (left, one), (right, other) = (now.get(side, (NO_ARM, 1.0)) for side in SIDES)
            return scene.first_blocked(left, right, (one, other)) is None

        return free

    def _run(self, commands: Iterable[Command]) -> None:
        moved = not self.simulation.released
        for command, velocity in commands:
            self.advance(command, velocity)
            if moved and self.simulation.released:
                break

    def _note(self, plan: MeetingPlan, passed: Sequence[tuple[float, int]]) -> None:
        rows, steps = np.array(passed, float).T
        for run in plan.runs:
            start, end = max(run.start, rows[0]), min(run.end, rows[-1])
            if start < end:
                start, end = np.interp([start, end], rows, steps).astype(int).tolist()
                self._runs.append(replace(run, start=start, end=end))

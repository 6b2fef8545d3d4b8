"""Reference policies without training. All but `random` and `still` are shown the simulation."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.scenes.case import Case, expert_actions
from pipeline.evaluate.scenes.trial import Trial
from pipeline.expert.actor import Actor, Skill
from pipeline.motion.planar import PlanarMotion
from pipeline.planning.failure import PlanFailure
from pipeline.planning.kinematics import ik_many
from pipeline.planning.planner import Planner
from pipeline.poses import Floats, Pose, compose, inverse
from pipeline.stages.failure import Failure
from pipeline.stages.scene import Scene

from .policy import LONGEST_CHUNK, Observation, PolicyError, Start


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """The first half of a script for a target at `aim` (7,). `actions` (T,A) are one a control
    period; `meeting` (s) is the first touch, or the end; `held` what was in which hand then."""

    aim: Pose
    actions: Floats
    last_skill: int
    meeting: float
    held: dict[str, str]


def rehearse(scene: Scene, aim: Pose, fps: int) -> Rehearsal | None:
    """Plan and run `meet` with the target at `aim` (7,); None without a plan."""
    return _rehearse(_SceneKey(scene.spec, scene.rules, scene), tuple(map(float, aim)), fps)


@dataclass(frozen=True)
class _SceneKey:
    spec: EpisodeSpec
    rules: Rules
    scene: Scene = field(compare=False)


@lru_cache(maxsize=32)
def _rehearse(key: _SceneKey, at: tuple[float, ...], fps: int) -> Rehearsal | None:
    scene, aim, task = key.scene, np.array(at), key.scene.task
    try:
        # the expert's own stream: with the target at the manipulation pose this is its plan
        actor = with_target_at(scene, aim).start(PlanarMotion.still(aim, 1.0), fps, "dry_run")
        began = 0
        for skill in task.meet(actor):
            began = actor.simulation.steps
            actor.perform(skill)
    except (Failure, PlanFailure):
        return None
    actions = at_control_rate(np.array(actor.stream.commands), PHYSICS_HZ // fps)
    actions.setflags(write=False)
    met = (e.time for e in actor.simulation.events if e.name == "meeting")
    meeting = next(met, actor.simulation.time)
    return Rehearsal(aim, actions, began // (PHYSICS_HZ // fps), meeting, dict(actor.held))


def with_target_at(scene: Scene, aim: Pose) -> Scene:
    """The target, and what lies in it, moved to `aim` (7,)."""
    target, bodies = scene.task.target, dict(scene.bodies)
    moved = compose(aim, inverse(bodies[target].pose))
    for name, body in scene.bodies.items():
        if target in (name, body.inside):
            bodies[name] = replace(body, pose=compose(moved, body.pose))
    return replace(scene, bodies=bodies)


def live(actor: Actor, skills: Iterator[Skill], fps: int) -> Iterator[Floats]:
    """Motions, actions (N,A). Ask for the next only after the last was executed."""
    try:
        for skill in skills:
            for step in skill(actor):
                yield at_control_rate(actor.commands(step)[0], PHYSICS_HZ // fps)
    except PlanFailure:
        return


def at_control_rate(commands: Floats, every: int) -> Floats:
    """The last of every `every` rows (N,A)."""
    index = np.minimum(np.arange(every, len(commands) + every, every), len(commands)) - 1
    return commands[index]


FIRST_GUESSES = (2.0, 1.0, 3.0)
"""s; when the robot may meet the target: its place then may be out of reach."""


class _Stream:
    """Takes motions, actions (N,A), from a generator, then holds the last command. A chunk never
    spans two motions: the next is planned from the state in which one ended."""

    scripted = True
    """Its chunks do not begin at the observation: no `async` clock can skip into them."""

    def __init__(self, chunk: float = 1) -> None:
        if chunk != int(chunk) or not 1 <= chunk <= LONGEST_CHUNK:
            raise PolicyError(f"chunk={chunk:g}: give a whole number, 1 to {LONGEST_CHUNK}")
        self._chunk = int(chunk)
        self._motions: Iterator[Floats] = iter(())
        self._ready, self._last = np.empty((0, 0)), cast(Floats | None, None)

    def reset(self, start: Start) -> None:
        self._motions, self._ready, self._last = iter(()), np.empty((0, 0)), None

    def act(self, observation: Observation) -> ArrayLike:
        while not len(self._ready):
            motion = next(self._motions, None)
            if motion is None:
                return observation.joints if self._last is None else self._last
            self._ready = motion
        answer, self._ready = self._ready[: self._chunk], self._ready[self._chunk :]
        self._last = answer[-1]
        return answer


class ReplayPolicy(_Stream):
    """The expert's recorded actions: the upper bound."""

    def see(self, trial: Trial, case: Case) -> None:
        self._motions = iter([expert_actions(case)])


class Static(_Stream):
    """The expert plans for the target at the start; what comes after the meeting is live."""

    def see(self, trial: Trial, case: Case) -> None:
        self._motions = _open_loop(trial, _plan_as_it_stands(trial))


class Interceptor(_Stream):
    """The expert assumes that the target keeps the velocity it has at the start, known to `noise` m
    (a third of it in m/s). For the first `delay` s it holds still, then takes what it saw at the
    start for the present."""

    def __init__(self, noise: float = 0.0, delay: float = 0.0, chunk: float = 1) -> None:
        super().__init__(chunk)
        self._noise, self._delay = noise, delay

    def see(self, trial: Trial, case: Case) -> None:
        rng = np.random.default_rng([case.spec.seed, 1])
        at = trial.simulation.pose(trial.scene.task.target)
        velocity = trial.simulation.target_twist()[:3].copy()
        at[:2] += rng.normal(0, 1, 2) * self._noise
        velocity[:2] += rng.normal(0, 1, 2) * self._noise / 3
        plan = _meeting_plan(trial, at, velocity)
        self._motions = _open_loop(trial, plan, self._delay)


class Chaser(_Stream):
    """The expert plans for the target at the start, then follows it without foresight."""

    RAMP = 0.5  # s over which it turns from its plan to the moving target, in the last skill

    def __init__(self) -> None:
        super().__init__()  # every action needs the newest position: no chunks

    def see(self, trial: Trial, case: Case) -> None:
        plan = _plan_as_it_stands(trial)
        self._motions = self._acts(trial, plan) if plan else iter(())

    def _acts(self, trial: Trial, plan: Rehearsal) -> Iterator[Floats]:
        yield from self._follow(trial, plan)
        yield from _finish(trial, plan)

    def _follow(self, trial: Trial, plan: Rehearsal) -> Iterator[Floats]:
        planner, target = trial.actor.planner, trial.scene.task.target
        yield plan.actions[: plan.last_skill]
        rows = plan.actions[plan.last_skill :]
        moving = [
            side
            for side in planner.embodiment.sides
            if np.ptp([planner.split(row)[side][0] for row in rows], axis=0).max() > 1e-3
        ]
        offset = np.zeros(3)
        for n, row in enumerate(rows):
            if not trial.simulation.released:
                share = min(1.0, n / (self.RAMP * trial.fps))
                offset = share * (trial.simulation.pose(target)[:3] - plan.aim[:3])
            yield _shift(planner, row, trial.simulation.command, moving, offset)[None]


class Tapper(Chaser):
    """Follows the target until it touches it, goes back, and acts as in a still scene: all it
    solves beyond `Static`, the first touch gave it. Where something is carried to the target it
    acts as in a still scene at once."""

    def _acts(self, trial: Trial, plan: Rehearsal) -> Iterator[Floats]:
        task = trial.scene.task
        if task.manipulated != task.target:
            yield from _open_loop(trial, plan)
            return
        way = [trial.simulation.command[None]]
        for motion in self._follow(trial, plan):
            yield motion
            way.append(motion)
            if trial.simulation.touched_by:
                break
        yield np.concatenate(way)[::-1]
        yield from _open_loop(trial, _plan_as_it_stands(trial))


def _plan_as_it_stands(trial: Trial) -> Rehearsal | None:
    return rehearse(trial.scene, trial.simulation.pose(trial.scene.task.target), trial.fps)


def _meeting_plan(trial: Trial, at: Pose, velocity: Floats) -> Rehearsal | None:
    """The rehearsal, within 2 mm, for a target at `at` (7,) with this velocity (3,), or None."""

    def ahead(seconds: float) -> Pose:
        return np.concatenate([at[:3] + velocity * seconds, at[3:]])

    tried = (rehearse(trial.scene, ahead(guess), trial.fps) for guess in FIRST_GUESSES)
    plan = next((rehearsal for rehearsal in tried if rehearsal), None)
    for _ in range(5):
        if plan is None or np.linalg.norm(ahead(plan.meeting)[:3] - plan.aim[:3]) < 0.002:
            break
        plan = rehearse(trial.scene, ahead(plan.meeting), trial.fps) or plan
    return plan


class Still:
    def reset(self, start: Start) -> None:
        self._at: Floats | None = None

    def act(self, observation: Observation) -> ArrayLike:
        self._at = observation.joints if self._at is None else self._at
        return self._at


class Random:
    """A random walk of the drive targets; grippers open and close."""

    STEP = 0.06  # standard deviation (rad or m) of a step

    def reset(self, start: Start) -> None:
        self._rng, self._at = np.random.default_rng([start.seed, 2]), None
        names = enumerate(start.action_names)
        self._grippers = [i for i, name in names if name.endswith("gripper")]

    def act(self, observation: Observation) -> ArrayLike:
        before = observation.joints if self._at is None else self._at
        self._at = before + self._rng.normal(0, self.STEP, len(before))
        self._at[self._grippers] = np.clip(self._at[self._grippers], 0, 1)
        return self._at


def _open_loop(trial: Trial, plan: Rehearsal | None, delay: float = 0.0) -> Iterator[Floats]:
    """The rehearsed motion after `delay` s, then the rest."""
    if plan is None:
        return
    yield np.repeat(trial.simulation.command[None], round(delay * trial.fps), axis=0)
    yield plan.actions
    yield from _finish(trial, plan)


def _finish(trial: Trial, plan: Rehearsal) -> Iterator[Floats]:
    trial.actor.held = dict(plan.held)
    yield from live(trial.actor, trial.scene.task.finish(trial.actor), trial.fps)


def _shift(
    planner: Planner, row: Floats, command: Floats, sides: list[str], offset: Floats
) -> Floats:
    """The action (A,), tools of `sides` moved by `offset` (3,) m if possible."""
    out, now = list[Floats](), planner.split(command)
    for side, (q, value) in planner.split(row).items():
        if side in sides and offset.any():
            pose: Pose = planner.fk(side, q)
            pose[:3] += offset
            joints, reached = ik_many(planner.chains[side], pose[None], now[side][0][None])
            q = joints[0] if reached[0] else now[side][0]
        out.append(np.append(q, value))
    return np.concatenate(out)

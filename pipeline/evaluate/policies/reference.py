"""Reference policies without training. All but `random` and `still` are shown the simulation."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.evaluate.scenes.case import Case, expert, expert_actions
from pipeline.evaluate.scenes.trial import Trial
from pipeline.planning.kinematics import ik_many
from pipeline.planning.planner import Planner
from pipeline.poses import Floats, Pose
from pipeline.stages.failure import Failure

from .policy import LONGEST_CHUNK, Observation, PolicyError, Start
from .rehearsal import Rehearsal, guess_roles, live, meeting_plan, rehearse, sight_of


class _Stream:
    """Takes motions, actions (N,A), from a generator, then holds the last command. A chunk never
    spans two motions: the next is planned from the state in which one ended."""

    scripted = True
    """Its chunks do not begin at the observation: no `async` clock can skip into them."""

    def __init__(self, chunk: float = 1) -> None:
        if chunk != int(chunk) or not 1 <= chunk <= LONGEST_CHUNK:
            raise PolicyError(
                f"--policy: chunk={chunk:g}: give a whole number, 1 to {LONGEST_CHUNK}"
            )
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


class Blind(_Stream):
    """The expert's actions in another scene of the same cell: what is typical of the task."""

    OTHERS = 20  # scenes tried until the expert solves one

    def see(self, trial: Trial, case: Case) -> None:
        for number in range(1, self.OTHERS + 1):
            with suppress(Failure):
                other = replace(case.spec, seed=case.spec.seed + number * 7919, arm="")
                log = expert(other, case.setup).replay.log
                self._motions = iter([log.action[:-1]])
                return


class Interceptor(_Stream):
    """The expert assumes that the target keeps the velocity it has at the start, known to `noise` m
    (a third of it in m/s). For the first `delay` s it holds still, then takes what it saw at the
    start for the present. Without its `cue` it guesses which of several like bodies is asked for.
    With `foresight` it knows the motion."""

    MOVING = True

    def __init__(
        self,
        noise: float = 0.0,
        delay: float = 0.0,
        chunk: float = 1,
        cue: float = 1,
        foresight: float = 0,
    ) -> None:
        super().__init__(chunk)
        for name, value in (("cue", cue), ("foresight", foresight)):
            if value not in (0, 1):
                raise PolicyError(f"--policy: {name}={value:g}: give 0 or 1")
        self._noise, self._delay, self._cue, self._foresight = noise, delay, cue, foresight

    def see(self, trial: Trial, case: Case) -> None:
        rng = np.random.default_rng([case.spec.seed, 1])
        seen, asked = trial.scene, trial.scene.task.target
        if not self._cue:
            seen, asked = guess_roles(seen, case.spec.seed)
        at, velocity = sight_of(trial, asked)
        at[:2] += rng.normal(0, 1, 2) * self._noise
        velocity[:2] += rng.normal(0, 1, 2) * self._noise / 3
        velocity *= self.MOVING

        def ahead(seconds: float) -> Pose:
            if self._foresight:
                return trial.motion.pose(trial.time + seconds)
            return np.concatenate([at[:3] + velocity * seconds, at[3:]])

        plan = meeting_plan(seen, trial.fps, ahead)
        self._motions = _open_loop(trial, plan, self._delay, ends=seen is not trial.scene)


class Static(Interceptor):
    """The expert plans for the target at the start; what comes after the meeting is live."""

    MOVING = False

    def __init__(self, chunk: float = 1, cue: float = 1) -> None:
        super().__init__(chunk=chunk, cue=cue)


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
        scene = trial.scene.give_roles(trial.simulation.roles)
        if scene is not trial.scene:  # an event gave it another target
            plan = rehearse(scene, plan.aim, trial.fps) or plan
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


def _open_loop(
    trial: Trial, plan: Rehearsal | None, delay: float = 0.0, *, ends: bool = False
) -> Iterator[Floats]:
    """The rehearsed motion after `delay` s, then the rest unless it `ends` there."""
    if plan is None:
        return
    yield np.repeat(trial.simulation.command[None], round(delay * trial.fps), axis=0)
    yield plan.actions
    if not ends:
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

"""The reactive expert as a policy: it sees no more of the target than the head camera does."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from pipeline.data.setup.rules import Sight
from pipeline.evaluate.scenes.case import Case
from pipeline.evaluate.scenes.trial import Trial
from pipeline.expert.actor import MotionStep
from pipeline.expert.reactive.actor import ReactiveActor
from pipeline.expert.reactive.prediction import TargetFilter
from pipeline.motion.scenery import Prop
from pipeline.planning.failure import PlanFailure
from pipeline.poses import Floats, Pose, compose, inverse, quat_rotate

from .reference import Interceptor
from .rehearsal import guess_roles
from .turns import Turns

FOREVER = 1e9  # s


class Reactive(Interceptor):
    """It sees the target `delay` s late, with an error of `noise` m, and not inside a tunnel;
    unseen for `memory` s (0: any time), the target is taken to rest. Without its `cue` it may take
    a like body for the target: then it acts as `Interceptor`."""

    def __init__(
        self, noise: float = 0.0, delay: float = 0.0, cue: float = 1, memory: float = 0
    ) -> None:
        super().__init__(cue=cue)
        self._sight, self._memory = Sight(noise=noise, delay=delay), memory or FOREVER

    def see(self, trial: Trial, case: Case) -> None:
        scene, own = trial.scene, trial.actor
        if not self._cue and guess_roles(scene, case.spec.seed)[0] is not scene:
            super().see(trial, case)
            return
        rng, limit = case.spec.rng("planning/react"), scene.task.step_limit
        actor = _Asked(trial.simulation, trial.recorder, own.bodies, own.arms, rng, limit)

        def act(turns: Turns[Trial, Floats]) -> None:
            turns.first()
            actor.begin(turns.after, trial, self._memory)
            actor.attend(self._sight, scene.task, case.spec.rng("sight"))
            with suppress(PlanFailure):
                while not np.isfinite(actor.track.time):
                    actor.wait(1 / trial.fps)
                actor.meet(scene.task.meet)
                for skill in scene.task.finish(actor):
                    actor.perform(skill)

        self._motions = _actions(Turns(act), trial)


class _Asked(ReactiveActor):
    """Gives one action for every control period in place of steps."""

    def begin(self, give: Callable[[Floats], object], trial: Trial, memory: float) -> None:
        self._give, self._period, self._memory = give, trial.per_period, memory
        self._commands = list[Floats]()
        self._eye, self._props = trial.scene.embodiment.head_camera, trial.scene.scenery

    def advance(self, command: Floats, velocity: Floats) -> None:
        self._commands.append(command)
        if len(self._commands) == self._period:
            self._flush()

    def execute(self, step: MotionStep) -> None:
        super().execute(step)
        self._flush()

    def wait(self, seconds: float) -> None:
        self._flush()
        super().wait(seconds)
        self._flush()

    def _flush(self) -> None:
        if not self._commands:
            return
        last, self._commands = self._commands[-1], []
        self._give(last)
        now = self.simulation.time
        self._look()
        if np.isfinite(self.track.time) and now - self.track.time > self._memory:
            believed = self.track.predict(now)
            box = self.bodies[self.simulation.target].instance.shape().aabb()
            self.track = TargetFilter(self.sight.noise, box.mean(axis=0))
            self.track.see(now, believed)

    def is_hidden(self, point: Floats) -> bool:
        return super().is_hidden(point) or any(
            prop.solid and blocks(prop, self.simulation.time, self._eye, point)
            for prop in self._props
        )


def blocks(prop: Prop, time: float, eye: Pose, point: Floats) -> bool:
    """Whether a box of a prop is between two points (3,)."""
    for piece in prop.pieces:
        if piece.kind != "box":
            continue
        back = inverse(compose(prop.pose(time), piece.at))
        start, end = (back[:3] + quat_rotate(back[3:], at) for at in (eye[:3], point))
        way = np.where(end == start, 1e-12, end - start)
        edges = np.sort([(-np.array(piece.size) - start) / way, (piece.size - start) / way], axis=0)
        if max(0.0, edges[0].max()) < min(1.0, edges[1].min()):
            return True
    return False


def _actions(turns: Turns[Trial, Floats], trial: Trial) -> Iterator[Floats]:
    try:
        while (action := turns.ask(trial)) is not None:
            yield action[None]
    finally:
        turns.end()

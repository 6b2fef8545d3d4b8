"""Demonstrations that follow the target visibly, made by a reactive expert that knows the target's
future.

It separates two differences between the planned and the reactive expert of docs/science/causal.md:
following the target in view, and knowing only the past.
"""

import numpy as np

from pipeline.data.names import SIDES
from pipeline.data.setup.rules import Sight
from pipeline.expert.reactive.actor import KEPT, Attended, ReactiveActor
from pipeline.expert.reactive.prediction import TargetFilter
from pipeline.motion.contract import TargetMotion
from pipeline.poses import Pose
from pipeline.stages.dry_run import DryRun
from pipeline.stages.failure import failing_as
from pipeline.stages.replay import REACT, ReactiveDemonstrator, Replay, finish
from pipeline.stages.scene import Scene
from pipeline.world.physics.simulation import Simulation
from training.ladder.demonstrations import Demonstration, DemonstrationJob, fill


class Foresight(TargetFilter):
    """The true motion of a target in place of a prediction, until the target is touched.

    `further` (s) is added to every time that is asked for.
    """

    def __init__(self, simulation: Simulation) -> None:
        super().__init__()
        self._simulation, self.further = simulation, 0.0

    def see(self, time: float, pose: Pose) -> None:
        """Take in a sighting, which is never a surprise."""
        super().see(time, pose)
        self.surprise = 0.0

    def predict(self, time: float) -> Pose:
        """The pose (7,) of the target at `time` (s)."""
        if self._simulation.released:
            return super().predict(time)
        return np.asarray(self._simulation.motion.pose(np.asarray(time + self.further)), float)


class ForesightedActor(ReactiveActor):
    """The reactive expert with the target's true future: it does all else alike."""

    def attend(self, sight: Sight, task: Attended, rng: np.random.Generator) -> None:
        """Begin to look at the target, whose sightings only count after the touch."""
        super().attend(sight, task, rng)
        self._future = Foresight(self.simulation)
        self._future.see(self.simulation.time, self.simulation.pose(self.simulation.target))
        self.track = self._future

    def _expected(self, seconds: float, share: float = 0.0) -> Pose:
        """The true pose after `seconds`: the reactive expert expects the target to slow down, and
        so asks for an earlier time."""
        self._future.further = seconds - KEPT * (1.0 - np.exp(-seconds / KEPT))
        try:
            return super()._expected(seconds, share)
        finally:
            self._future.further = 0.0


class Foresighted(ReactiveDemonstrator):
    """This expert as the demonstrator of an attempt."""

    def show(self, scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
        actor = scene.start(motion, fps, REACT, ForesightedActor)
        actor.recorder.watched = SIDES
        with failing_as(REACT, actor):
            actor.attend(self.sight, scene.task, scene.spec.rng("sight"))
            actor.meet(scene.task.meet)
            return finish(scene, actor, REACT)


def fill_foreseen(job: DemonstrationJob) -> Demonstration | None:
    """As `fill`, by this expert."""
    return fill(job, Foresighted(job.recipe.sight))

"""The scene of one attempt: everything that follows from its spec before physics starts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.expert.actor import Actor
from pipeline.expert.failure import PlanFailure
from pipeline.expert.planner import planner_for
from pipeline.spec import EpisodeSpec
from pipeline.stages.failure import Failure
from pipeline.tasks import TASKS, Task, place
from pipeline.tasks.outcome import Outcome
from pipeline.world.body import Body
from pipeline.world.cameras import cameras_of, visible
from pipeline.world.recorder import Recorder
from pipeline.world.robots import get_embodiment
from pipeline.world.robots.contract import Embodiment
from pipeline.world.simulation import Motion, Simulation
from pipeline.world.state_log import StateLog

FRAME_MARGIN = 4.0
"""Pixels between the target and the border of the head camera's picture (D435) that count as seen."""


@dataclass(frozen=True, eq=False)
class Stage:
    """A spec with its task, robot, bodies at their manipulation poses, and the roles of the arms."""

    spec: EpisodeSpec
    task: Task
    embodiment: Embodiment
    bodies: dict[str, Body]
    arms: dict[str, str]

    def start(self, motion: Motion, fps: int, purpose: str) -> Actor:
        """A settled simulation with its recorder and expert. Raises Failure("unstable") when bodies do not come to rest."""
        simulation = Simulation(self.embodiment, tuple(self.bodies.values()), self.task.target, motion)
        if not simulation.settle():
            raise Failure(purpose, "unstable", f"a body still moves, or touches {self.task.target}, before the start")
        return Actor(
            simulation,
            Recorder(simulation, fps),
            self.bodies,
            self.arms,
            planner_for(self.spec.embodiment),
            self.spec.rng(f"planning/{purpose}"),
            self.task.step_limit,
        )

    def outcome(self, log: StateLog) -> Outcome:
        """The log with the names and frames of this scene."""
        return Outcome(log, self.bodies, self.embodiment, self.task.target)

    def succeeded(self, log: StateLog) -> bool:
        """Whether the task's one success condition holds at the end of the log."""
        return bool(self.task.success(self.outcome(log), self.arms))


def set_stage(spec: EpisodeSpec) -> Stage:
    """Lay out the scene of a spec; a pure function of it. Raises Failure("layout") where the bodies do not fit."""
    task = TASKS[spec.task]
    embodiment = get_embodiment(spec.embodiment)
    head = cameras_of(embodiment)[0]

    def in_view(point: NDArray[np.float64]) -> bool:
        return bool(visible(head.type, head.pose, point, FRAME_MARGIN))

    try:
        bodies = place(task, spec.rng("objects"), spec.rng("placement"), in_view)
    except PlanFailure as failure:
        raise Failure("layout", failure.reason, str(failure)) from failure
    return Stage(spec, task, embodiment, bodies, task.arms(bodies))


def success_time(stage: Stage, log: StateLog) -> float | None:
    """Time (s) from which the success condition holds until the end of the log, or None where it fails at the end."""
    outcome, since = stage.outcome(log), None
    for frames in range(len(log), 0, -1):
        if not stage.task.success(outcome.until(frames), stage.arms):
            break
        since = float(log.times[frames - 1])
    return since


def rest(actor: Actor, task: Task, seconds: float = 0.4) -> None:
    """Hold still at the end of a script so that what was let go can come to rest."""
    actor.wait(seconds)
    actor.wait((-actor.simulation.steps % (240 // actor.recorder.fps)) / 240)


__all__ = ["Stage", "rest", "set_stage", "success_time"]

"""Stage 3: the recorded plan against the moving target, on one clock; what follows the meeting is
planned live."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import Event, StateLog
from pipeline.data.names import SIDES
from pipeline.expert.actor import Actor
from pipeline.expert.tracking import TRACK, carried_along
from pipeline.motion.contract import TargetMotion
from pipeline.stages.dry_run import DryRun
from pipeline.stages.failure import Failure, failing_as, no_success
from pipeline.stages.scene import Scene, rest, success_time
from pipeline.tasks.outcome import failed

STAGE = "replay"


@dataclass(eq=False)
class Replay:
    """The accepted rollout: its state log (events included) and the physics steps it took."""

    log: StateLog
    steps: int


def replay(scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
    """Play the first half back while the target moves, then finish the script live.

    Raises Failure: missed (nothing touched the target in the first half), a planning reason,
    no_success, or clutter_touched.
    """
    actor = scene.start(motion, fps, STAGE)
    actor.recorder.watched = SIDES
    with failing_as(STAGE, actor):
        rows, velocities = commands(actor, dry, motion)
        runs = [
            replace(run, end=len(rows)) if run.end == len(dry.commands) else run for run in dry.runs
        ]
        actor.play(rows, velocities, runs)
        if not actor.simulation.touched_by:
            raise Failure(
                STAGE, "missed", f"nothing touched the {scene.task.target} at the meeting"
            )
        actor.held = dict(dry.held)
        return finish(scene, actor, STAGE)


def commands(
    actor: Actor, dry: DryRun, motion: TargetMotion
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The commands of the dry run and their velocities; a hand that tracks the target moves along.
    Raises PlanFailure."""
    tracking = next((run for run in dry.runs if run.skill == TRACK), None)
    if tracking is None or not motion.level:
        return dry.commands, dry.velocities
    met = min(round(dry.meeting * PHYSICS_HZ), len(dry.commands)) - 1
    return carried_along(actor.planner, (dry.commands, dry.velocities), tracking, motion.pose, met)


def finish(scene: Scene, actor: Actor, stage: str) -> Replay:
    """Finish the script live after the meeting, and judge the episode. Raises PlanFailure and
    Failure of `stage`."""
    actor.half = "finish"
    # named: an error in a skill is reported at the line that yielded it
    script = scene.task.finish(actor)
    for skill in script:
        actor.perform(skill)
    rest(actor, scene.task)
    since = success_time(scene, actor.recorder.log())
    if since is None:
        raise no_success(stage, failed(scene.conditions(actor.recorder.log())))
    if touched := scene.touched_distractor(actor.recorder.log()):
        raise Failure(stage, "clutter_touched", f"something touched {touched}")
    actor.recorder.extra.append(Event("success", since))
    return Replay(actor.log(), actor.steps)

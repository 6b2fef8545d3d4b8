"""Stage 1: the expert meets a still target (paper, appendix D.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import SkillRun
from pipeline.expert.actor import Actor
from pipeline.motion.planar import PlanarMotion
from pipeline.poses import Floats
from pipeline.tasks.outcome import failed

from .failure import Failure, failing_as, no_success
from .scene import Scene, rest

DRY_RUN = "dry_run"


@dataclass(frozen=True, eq=False)
class Variation:
    """A dry run that grasps from directions (3,) other than `avoid` and waits `pause` s before
    skill `before` of `meet`.
    """

    avoid: Sequence[Floats] = ()
    pause: float = 0.0
    before: int = 0


FIRST = Variation()


@dataclass(eq=False)
class DryRun:
    """What the replay needs: commands of the first half (M,A), the time of the meeting (s), and the
    sweep: poses (S,B,7) at 60 Hz.

    `approach` (3,) is the direction of the grasp. `skills` counts those of `meet`; the last begins
    in row `last`.
    """

    commands: Floats
    velocities: Floats
    meeting: float
    held: dict[str, str]
    sweep: Floats
    names: tuple[str, ...]
    steps: int
    approach: Floats | None
    skills: int = 0
    last: int = 0
    runs: Sequence[SkillRun] = ()


def dry_run(scene: Scene, fps: int, variation: Variation = FIRST) -> DryRun:
    """Plan and run the whole script in the still scene. Raises Failure."""
    task = scene.task
    end = scene.bodies[task.target].pose
    actor = scene.start(PlanarMotion.still(end, 1.0), fps, DRY_RUN)
    actor.sweeping, actor.avoid[task.target] = True, list(variation.avoid)
    with failing_as(DRY_RUN, actor):
        last_began, skills, script = 0.0, 0, task.meet(actor)
        for skills, skill in enumerate(script, 1):
            if skills - 1 == variation.before:
                actor.wait(variation.pause)
            last_began = actor.simulation.time
            if actor.simulation.touched_by:
                raise _too_soon(actor)
            actor.perform(skill)
        half, runs = len(actor.stream.commands), actor.skills
        held, sweep, actor.sweeping = dict(actor.held), np.array(actor.sweep), False
        approach = actor.approaches.get(task.target)
        actor.avoid.clear()
        meeting = next((e.time for e in actor.simulation.events if e.name == "meeting"), None)
        if meeting is None:
            raise Failure(DRY_RUN, "no_meeting", f"nothing touched the {task.target}")
        if meeting < last_began:
            raise _too_soon(actor)
        actor.half = "finish"
        script = task.finish(actor)
        for skill in script:
            actor.perform(skill)
        rest(actor, task)
        if conditions := failed(scene.conditions(actor.recorder.log())):
            raise no_success(DRY_RUN, conditions)
    commands, velocities = np.array(actor.stream.commands), np.array(actor.stream.velocities)
    first = commands[:half], velocities[:half], meeting, held, sweep, actor.simulation.names
    last = round(last_began * PHYSICS_HZ)
    return DryRun(*first, actor.steps, approach, skills, last, runs)


def _too_soon(actor: Actor) -> Failure:
    by = actor.simulation.touched_by
    return Failure(DRY_RUN, "early_meeting", f"{by} touched the target too soon")

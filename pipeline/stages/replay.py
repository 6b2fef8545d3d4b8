"""Stage 3: the target moves, and a demonstrator meets it."""

from dataclasses import dataclass, replace
from typing import Any, Protocol

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import Event, StateLog
from pipeline.data.names import SIDES
from pipeline.data.setup import Setup
from pipeline.data.setup.rules import Sight
from pipeline.expert.actor import Actor
from pipeline.expert.reactive.actor import ReactiveActor
from pipeline.expert.tracking import TRACK, carried_along
from pipeline.motion.contract import TargetMotion
from pipeline.motion.wrapped import Changed
from pipeline.poses import Floats
from pipeline.tasks.outcome import failed

from .dry_run import DryRun
from .failure import Failure, failing_as, no_success
from .scene import Scene, rest, success_time

REPLAY, REACT = "replay", "react"


@dataclass(eq=False)
class Replay:
    """An accepted rollout; `motion` is the target's if events have changed it."""

    log: StateLog
    steps: int
    motion: TargetMotion | None = None


class Demonstrator(Protocol):
    """Does the third stage of an attempt."""

    def describe(self) -> dict[str, Any]:
        """The fields `expert` and `corrects` of EpisodeMeta."""
        ...

    def check(self) -> None:
        """Raise PolicyError if it cannot act."""

    def show(self, scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
        """The rollout of a scene whose target moves so. Raises Failure."""
        ...


class PlannedDemonstrator(Demonstrator):
    """Knows where and when it meets the target."""

    def describe(self) -> dict[str, Any]:
        return {"expert": "planned"}

    def show(self, scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
        return replay(scene, dry, motion, fps)


@dataclass(frozen=True)
class ReactiveDemonstrator(Demonstrator):
    """Sees the past of the target through its `sight`."""

    sight: Sight

    def describe(self) -> dict[str, Any]:
        return {"expert": "reactive"}

    def show(self, scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
        return react(scene, motion, self.sight, fps)


def expert_of(setup: Setup) -> Demonstrator:
    seen = setup.reactive
    return PlannedDemonstrator() if seen is None else ReactiveDemonstrator(seen)


def replay(scene: Scene, dry: DryRun, motion: TargetMotion, fps: int) -> Replay:
    """Play the first half back while the target moves, then finish live. Raises as `show`.

    If an event changes target or motion before the meeting, the reactive expert takes over.
    """
    actor = scene.start(motion, fps, REPLAY, ReactiveActor if scene.events else Actor)
    actor.recorder.watched = SIDES
    with failing_as(REPLAY, actor):
        if isinstance(actor, ReactiveActor):
            actor.attend(Sight(), scene.task, scene.spec.rng("sight"))
        rows, velocities = commands(actor, dry, motion)
        whole = len(dry.commands)
        runs = [replace(run, end=len(rows)) if run.end == whole else run for run in dry.runs]
        world = actor.simulation
        changed = actor.play(
            rows,
            velocities,
            runs,
            until=lambda row: (
                row >= dry.last
                and (isinstance(world.motion, Changed) or bool(world.roles))
                and not world.touched_by
            ),
        )
        if changed and isinstance(actor, ReactiveActor):
            target = scene.task.target
            actor.held = {side: name for side, name in dry.held.items() if name != target}
            actor.meet(scene.task.meet, rest=True)
            return finish(scene, actor, REPLAY)
        if not world.touched_by:
            why = f"nothing touched the {scene.task.target} at the meeting"
            raise Failure(REPLAY, "missed", why)
        actor.held = dict(dry.held)
        return finish(scene, actor, REPLAY)


def react(scene: Scene, motion: TargetMotion, sight: Sight, fps: int) -> Replay:
    """Meet the target without knowing its motion, then finish live. Raises as `show`."""
    actor = scene.start(motion, fps, REACT, ReactiveActor)
    actor.recorder.watched = SIDES
    with failing_as(REACT, actor):
        actor.attend(sight, scene.task, scene.spec.rng("sight"))
        actor.meet(scene.task.meet)
        return finish(scene, actor, REACT)


def commands(actor: Actor, dry: DryRun, motion: TargetMotion) -> tuple[Floats, Floats]:
    """Commands (M,A) of the dry run and velocities; a tracking hand moves along. Raises
    PlanFailure.
    """
    tracking = next((run for run in dry.runs if run.skill == TRACK), None)
    if tracking is None or not motion.level:
        return dry.commands, dry.velocities
    met = min(round(dry.meeting * PHYSICS_HZ), len(dry.commands)) - 1
    return carried_along(actor.planner, (dry.commands, dry.velocities), tracking, motion.pose, met)


def finish(scene: Scene, actor: Actor, stage: str) -> Replay:
    """Finish the script live and judge it. Raises PlanFailure and Failure of `stage`."""
    actor.half = "finish"
    # named: an error in a skill is reported at the line that yielded it
    script = scene.task.finish(actor)
    for skill in script:
        actor.perform(skill)
    rest(actor, scene.task)
    log = actor.recorder.log()
    since = success_time(scene, log)
    if since is None:
        raise no_success(stage, failed(scene.conditions(log)))
    if touched := next((event.by for event in log.events if event.name == "clutter_touched"), ""):
        raise Failure(stage, "clutter_touched", f"something touched {touched}")
    actor.recorder.extra.append(Event("success", since))
    motion = actor.simulation.motion
    return Replay(actor.log(), actor.steps, motion if isinstance(motion, Changed) else None)

"""One attempt at one spec: the three stages."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pipeline.data.process.own_code import raise_own
from pipeline.data.setup import Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.expert.candidates import near_one
from pipeline.motion.contract import TargetMotion
from pipeline.poses import Floats
from pipeline.tasks import TASKS

from .back_calculate import back_calculate
from .dry_run import DryRun, Variation, dry_run
from .failure import Failure
from .replay import Demonstrator, Replay, expert_of
from .scene import Scene, build_scene

GRASPS = 3  # directions from which the target is grasped at most, until its motion fits

PAUSES = (0.7, 1.4)
"""Seconds for which a robot that does not grasp the target waits before its last move, in turn:
what it took is out of the target's way by then."""


@dataclass(eq=False)
class Rollout:
    """An accepted attempt before it has images."""

    scene: Scene
    motion: TargetMotion
    meeting: float
    replay: Replay
    steps: int
    demonstrator: Demonstrator


def _dry_runs(scene: Scene, fps: int) -> Iterator[DryRun]:
    """Dry runs that differ in grasp or timing. Raises Failure."""
    first = dry = dry_run(scene, fps)
    yield dry
    if first.approach is None:
        for pause in PAUSES:
            yield dry_run(scene, fps, Variation(pause=pause, before=first.skills - 1))
        return
    avoid = list[Floats]()
    while (
        dry.approach is not None
        and len(avoid) + 1 < GRASPS
        and not near_one(dry.approach[None], avoid)[0]
    ):
        avoid.append(dry.approach)
        dry = dry_run(scene, fps, Variation(avoid))
        yield dry


def draw_motion(scene: Scene, setup: Setup) -> tuple[DryRun, TargetMotion, int]:
    """A dry run, a motion that fits it, and the physics steps of all dry runs. Raises Failure.

    If a level hand bars every path, the target is grasped from another side or the robot waits.
    """
    steps, refused = 0, list[Failure]()
    try:
        try:
            for dry in _dry_runs(scene, setup.fps):
                steps += dry.steps
                try:
                    return dry, back_calculate(scene, dry, setup), steps
                except Failure as no_motion:
                    refused.append(no_motion)
        except Failure as failure:
            steps += failure.steps
            refused.append(failure)
        refused[0].steps = steps
        raise refused[0]
    finally:
        refused.clear()  # they refer to this frame


def attempt(
    spec: EpisodeSpec,
    setup: Setup,
    demonstrator: Demonstrator | None = None,
    frozen: Scene | None = None,
) -> Rollout:
    """The three stages for one spec; a `demonstrator` does the third, by default the setup's
    expert.

    Raises Failure with `steps` and `drawn` set, and OwnCodeError for code from outside the package.
    """
    steps, drawn, motion, meeting = 0, None, None, 0.0
    demonstrator = demonstrator or expert_of(setup)
    try:
        scene = frozen or build_scene(spec, setup.ruling())
        dry, motion, steps = draw_motion(scene, setup)
        drawn, meeting = motion.features(), dry.meeting
        scene = scene.furnished(motion)
        for arm in scene.spec.arms:  # a scene is kept if all of its arms succeed
            if arm != scene.spec.arm:
                twin = replace(scene, spec=replace(scene.spec, arm=arm))
                steps += demonstrator.show(twin, dry, motion, setup.fps).steps
        done = demonstrator.show(scene, dry, motion, setup.fps)
    except Failure as failure:
        failure.steps += steps
        failure.drawn, failure.motion, failure.meeting = failure.drawn or drawn, motion, meeting
        raise
    except Exception as error:
        raise_own(error, type(TASKS[spec.task]), f"task {spec.task}")
        raise
    went = done.motion or motion
    return Rollout(scene, went, dry.meeting, done, steps + done.steps, demonstrator)

"""Stage 3 with the reactive expert: it sees the target move, plans, follows and meets it, then
finishes the script live."""

from pipeline.data.names import SIDES
from pipeline.data.rules import Sight
from pipeline.expert.reactive.actor import ReactiveActor
from pipeline.motion.contract import TargetMotion
from pipeline.stages.failure import failing_as
from pipeline.stages.replay import Replay, finish
from pipeline.stages.scene import Scene

STAGE = "react"


def react(scene: Scene, motion: TargetMotion, sight: Sight, fps: int) -> Replay:
    """Meet the target without knowing its motion, then finish the script live.

    Raises Failure: missed (nothing touched the target), early_meeting, a planning reason,
    no_success, or clutter_touched.
    """
    actor = scene.start(motion, fps, STAGE, ReactiveActor)
    actor.recorder.watched = SIDES
    with failing_as(STAGE, actor):
        actor.attend(sight, scene.task.workspace, scene.spec.rng("sight"))
        actor.meet(scene.task.meet)
        return finish(scene, actor, STAGE)

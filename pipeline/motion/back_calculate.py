"""The motion that brings a target to its meeting on time, by the model that is asked for."""

from copy import deepcopy
from dataclasses import replace

from pipeline.motion.contract import MotionRequest, NoMotion, Streams, TargetMotion
from pipeline.motion.models import MODELS, PLANAR, levels_of


def back_calculate_motion(
    asked: MotionRequest, streams: Streams, model: str = PLANAR
) -> TargetMotion:
    """A motion of the model `model` that keeps `asked`.

    Level 0 and alpha 0 give the target that stands at the end pose, unchecked. Raises NoMotion if
    nothing was found, UnknownName for an unknown model, and ValueError for a level that the model
    does not have.
    """
    if asked.level not in (levels := levels_of(model)):
        raise ValueError(
            f"level {asked.level!r} is unknown: levels of {model} are {', '.join(map(str, levels))}"
        )
    if asked.level == 0 or asked.alpha == 0:
        return MODELS[model].stand(asked, streams)
    if asked.moving == (1.0,):
        return MODELS[model].draw(asked, streams)
    return _late(asked, streams, model)


def _late(asked: MotionRequest, streams: Streams, model: str) -> TargetMotion:
    """The motion that moves for the first of the shares `asked.moving` for which there is one.

    Every try draws the same numbers; at level 1 the first speed of the law is kept, because another
    one would mostly be slower. Raises the NoMotion of the first try.
    """
    total, refused = asked.lead + asked.duration, list[NoMotion]()
    kept = replace(asked, candidates=1) if asked.level == 1 else asked
    for share in asked.moving:
        try:
            return MODELS[model].draw(
                replace(kept, lead=share * total - asked.duration), deepcopy(streams)
            )
        except NoMotion as no:
            refused.append(no)
    raise refused[0]

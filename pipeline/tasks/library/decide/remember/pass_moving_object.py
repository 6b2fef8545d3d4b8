import numpy as np

from pipeline.expert.skills import first_of, hand_over, lift, open_, retreat
from pipeline.poses import Floats, quat_about, quat_multiply
from pipeline.tasks.contract import (
    TABLE_TOP,
    Actor,
    Bodies,
    Draw,
    Skills,
    register,
)
from pipeline.tasks.library.domino.handle.handover_mic import HELD_UP, HandoverMic


@register
class PassMovingObject(HandoverMic):
    """Take a microphone off a belt with the arm beside it, and hand it to the other arm, head
    first.

    Success: as `handover_mic`."""

    motion = "conveyor"

    def layout(self, draw: Draw) -> Bodies:
        # the tail is where the giver's hand leans over it and leaves room for the other hand
        side = draw.side()
        yaw = (1.9, 6.3) if side < 0 else (-3.1, 1.2)
        yield draw.place("microphone", x=(side * 0.30, side * 0.20), y=(-0.15, 0.0), yaw=yaw)

    def finish(self, a: Actor) -> Skills:
        giver, receiver = a.arms["giver"], a.arms["receiver"]
        level = self._exchange(giver)
        yield lift(giver, 0.10)
        places = (_rolled(level), level)
        yield first_of(*(hand_over(giver, receiver, p, kinds=("neck",)) for p in places))
        yield open_(giver)
        yield retreat(giver, 0.10)
        missing = TABLE_TOP + HELD_UP - a.frame("microphone", "head")[2]
        if missing > 0:
            yield lift(receiver, missing)


def _rolled(places: Floats) -> Floats:
    """Poses (2N,7) of the microphone turned about its axis, one finger below it: between two
    upright fingers its weight turns it in the grip."""
    found = np.concatenate([places, places])
    for turn, some in zip((np.pi / 2, -np.pi / 2), np.split(found, 2), strict=True):
        some[:, 3:] = quat_multiply(some[:, 3:], quat_about((1.0, 0.0, 0.0), turn))
    return found

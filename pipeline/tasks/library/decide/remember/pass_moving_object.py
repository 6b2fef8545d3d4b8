import numpy as np

from pipeline.expert.actor import Skill
from pipeline.expert.skills import first_of, hand_over
from pipeline.poses import Floats, quat_about, quat_multiply
from pipeline.tasks.contract import Bodies, Draw, register
from pipeline.tasks.library.domino.handle.handover_mic import HandoverMic


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

    def passing(self, giver: str, receiver: str) -> Skill:
        level = self._exchange(giver)
        places = (_rolled(level), level)
        return first_of(*(hand_over(giver, receiver, p, kinds=("neck",)) for p in places))


def _rolled(places: Floats) -> Floats:
    """Poses (2N,7) of the microphone turned about its axis, one finger below it: between two
    upright fingers its weight turns it in the grip."""
    found = np.concatenate([places, places])
    for turn, some in zip((np.pi / 2, -np.pi / 2), np.split(found, 2), strict=True):
        some[:, 3:] = quat_multiply(some[:, 3:], quat_about((1.0, 0.0, 0.0), turn))
    return found

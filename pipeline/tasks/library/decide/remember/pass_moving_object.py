from pipeline.tasks.contract import register
from pipeline.tasks.library.domino.handle.handover_mic import HandoverMic


@register
class PassMovingObject(HandoverMic):
    """Take a microphone off a belt with the arm beside it, and hand it to the other arm, head
    first.

    Success: as `handover_mic`."""

    motion = "conveyor"

from pipeline.tasks.contract import register

from .pick_from_belt import PickFromBelt


@register
class TakeFromRamp(PickFromBelt):
    """Grasp a can or a bottle that slides down a ramp onto the table, and lift it.

    Success: as `pick_from_belt`."""

    motion = "ramp"

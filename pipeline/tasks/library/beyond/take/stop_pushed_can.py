from pipeline.tasks.contract import register

from .pick_from_belt import PickFromBelt


@register
class StopPushedCan(PickFromBelt):
    """Grasp a can or a bottle that a paddle has pushed and that slides, slowed by friction, off one
    cushion or two at level 3.

    Success: as `pick_from_belt`."""

    motion = "pushed"

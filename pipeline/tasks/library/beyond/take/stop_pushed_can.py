"""stop_pushed_can: take a can that slides across the table after a push."""

from pipeline.tasks.contract import register
from pipeline.tasks.library.beyond.take.pick_from_belt import PickFromBelt


@register
class StopPushedCan(PickFromBelt):
    """Grasp a can or a bottle that a paddle has pushed and that slides, slowed by friction, off one
    cushion or two at level 3.

    Success: that of `pick_from_belt`.
    """

    motion = "pushed"

from pipeline.tasks.contract import register

from .catch_dropped_ball import CatchDroppedBall


@register
class CatchDroppedBread(CatchDroppedBall):
    """Grasp a skillet and bring it from below to where a piece of bread that a carrier drops will
    be.

    Success: as `catch_dropped_ball`."""

    target = falls = "bread"

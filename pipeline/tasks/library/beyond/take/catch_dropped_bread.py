"""catch_dropped_bread: catch a piece of bread that falls, in a skillet."""

from pipeline.tasks.contract import register
from pipeline.tasks.library.beyond.take.catch_dropped_ball import CatchDroppedBall


@register
class CatchDroppedBread(CatchDroppedBall):
    """Grasp a skillet and bring it from below to where a piece of bread that a carrier drops will
    be.

    Success: that of `catch_dropped_ball`, for the bread.
    """

    target = falls = "bread"

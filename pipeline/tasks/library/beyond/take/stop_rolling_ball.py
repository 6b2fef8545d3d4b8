"""stop_rolling_ball: stop a ball that rolls across the table, and pick it up."""

from collections.abc import Iterator

from pipeline.tasks.contract import Draw, Placement, Region, register
from pipeline.tasks.library.beyond.take.pick_from_belt import PickFromBelt


@register
class StopRollingBall(PickFromBelt):
    """Close the gripper on a rolling ball and lift it.

    Success: that of `pick_from_belt`, for the ball.
    """

    target = manipulated = "ball"
    motion = "rolling"

    def layout(self, draw: Draw) -> Iterator[Placement]:
        region = Region(x=(-0.25, 0.25), y=(-0.20, 0.0), yaw=(-3.14, 3.14), away_from_centre=0.03)
        yield Placement("ball", draw.one_of("play_ball"), region)

from typing import cast

from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register
from pipeline.world.objects.families.toys.toy_car import PlayBall

from .pick_from_belt import PickFromBelt


@register
class StopOneOfTwoBalls(PickFromBelt):
    """Close the gripper on the ball of the colour asked for, while another one rolls across the
    table too, and lift it.

    Success: as `pick_from_belt`."""

    target = manipulated = "ball"
    motion, movers = "rolling", {"other": "rolling"}

    def layout(self, draw: Draw) -> Bodies:
        side, ball = draw.side(), cast(PlayBall, draw.one_of("play_ball"))
        other = cast(PlayBall, draw.one_of("play_ball"))
        while other.colour == ball.colour:
            other = cast(PlayBall, draw.one_of("play_ball"))
        near = Region(x=(side * 0.05, side * 0.25), y=(-0.20, 0.0), yaw=(-3.14, 3.14))
        yield Placement("ball", ball, near)
        yield Placement(
            "other",
            other,
            Region(x=(-0.25, 0.25), y=(-0.20, 0.10), yaw=(-3.14, 3.14)),
            distances={"ball": 0.14},
        )

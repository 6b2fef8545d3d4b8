from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register

from .pick_from_belt import PickFromBelt


@register
class StopRollingBall(PickFromBelt):
    """Close the gripper on a rolling ball and lift it.

    Success: as `pick_from_belt`."""

    target = manipulated = "ball"
    motion = "rolling"

    def layout(self, draw: Draw) -> Bodies:
        region = Region(x=(-0.25, 0.25), y=(-0.20, 0.0), yaw=(-3.14, 3.14), away_from_centre=0.03)
        yield Placement("ball", draw.one_of("play_ball"), region)

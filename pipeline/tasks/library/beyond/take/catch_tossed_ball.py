from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register
from pipeline.world.physics.body import TABLE_TOP

from .pick_from_belt import PickFromBelt


@register
class CatchTossedBall(PickFromBelt):
    """Close the gripper on a ball that a plate tosses up, at the top of its flight, and lift it.

    Success: as `pick_from_belt`."""

    target = manipulated = "ball"
    motion = "toss"

    def layout(self, draw: Draw) -> Bodies:
        z = TABLE_TOP + draw.uniform(0.12, 0.20)
        region = Region(
            x=(-0.25, 0.25), y=(-0.20, -0.05), yaw=(-3.14, 3.14), away_from_centre=0.05, z=z
        )
        yield Placement("ball", draw.one_of("play_ball"), region)

from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register
from pipeline.world.physics.body import TABLE_TOP

from .stand_on import StandOn


@register
class StandTossedCube(StandOn):
    """Close the gripper on a puzzle cube that a plate tosses up, at the top of its flight, and set
    it down on a pad.

    Success: as `StandOn`."""

    target = manipulated = "cube"
    motion = "toss"

    def layout(self, draw: Draw) -> Bodies:
        side, z = draw.side(), TABLE_TOP + draw.uniform(0.12, 0.20)
        air = Region(x=(side * 0.05, side * 0.18), y=(-0.18, -0.05), yaw=(-0.7, 0.7), z=z)
        yield Placement("cube", draw.one_of("rubiks_cube"), air)
        yield self.pad(draw, side, half=0.055, cube=0.14)

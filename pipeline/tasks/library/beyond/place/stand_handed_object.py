from pipeline.motion.workspace import Workspace
from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register
from pipeline.world.physics.body import TABLE_TOP

from .stand_on import StandOn


@register
class StandHandedObject(StandOn):
    """Grasp a can or a pill bottle that a flat hand brings, and stand it on a pad.

    Success: as `StandOn`."""

    target = manipulated = "object"
    motion = "handed"
    workspace = Workspace(-0.40, 0.40, -0.25, 0.30)

    def layout(self, draw: Draw) -> Bodies:
        side, z = draw.side(), TABLE_TOP + draw.uniform(0.08, 0.14)
        air = Region(x=(side * 0.05, side * 0.18), y=(-0.15, 0.0), yaw=(-3.14, 3.14), z=z)
        yield Placement("object", draw.one_of("can", "pill_bottle"), air, borne=True)
        yield self.pad(draw, side, object=0.14)

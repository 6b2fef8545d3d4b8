from pipeline.motion.workspace import Workspace
from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register
from pipeline.world.physics.body import TABLE_TOP

from .pick_from_belt import PickFromBelt


@register
class TakeHandedObject(PickFromBelt):
    """Grasp a can or a bottle that a flat hand brings, and lift it off the hand.

    Success: as `pick_from_belt`."""

    target = manipulated = "object"
    motion = "handed"
    workspace = Workspace(-0.40, 0.40, -0.25, 0.30)

    def layout(self, draw: Draw) -> Bodies:
        z = TABLE_TOP + draw.uniform(0.08, 0.14)
        region = Region(
            x=(-0.25, 0.25), y=(-0.18, 0.0), yaw=(-3.14, 3.14), away_from_centre=0.05, z=z
        )
        yield Placement("object", draw.one_of("can", "pill_bottle"), region, borne=True)

from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register
from pipeline.world.physics.body import TABLE_TOP

from .stand_on import StandOn


@register
class StandHangingMug(StandOn):
    """Grasp a mug that hangs over the table on a cord, draw it away from the cord, and stand it on
    a coaster.

    Success: as `StandOn`."""

    target = manipulated = "mug"
    support, motion = "coaster", "pendulum"
    kinds, away = ("side",), (0.0, -0.10, 0.0)

    def layout(self, draw: Draw) -> Bodies:
        side, z = draw.side(), TABLE_TOP + draw.uniform(0.06, 0.12)
        air = Region(x=(side * 0.05, side * 0.15), y=(-0.15, -0.05), yaw=(-3.14, 3.14), z=z)
        yield Placement("mug", draw.one_of("mug"), air, borne=True)
        coaster = Region(x=(side * 0.24, side * 0.30), y=(-0.20, 0.0))
        yield Placement("coaster", draw.one_of("coaster"), coaster, distances={"mug": 0.14})

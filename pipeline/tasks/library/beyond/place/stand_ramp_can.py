from pipeline.tasks.contract import Bodies, Draw, Placement, Region, register

from .stand_on import StandOn


@register
class StandRampCan(StandOn):
    """Grasp a can or a pill bottle that slides down a ramp onto the table, and stand it on a pad
    beside.

    Success: as `StandOn`."""

    target = manipulated = "can"
    motion = "ramp"

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield Placement(
            "can",
            draw.one_of("can", "pill_bottle"),
            Region(x=(side * 0.05, side * 0.15), y=(-0.18, -0.02)),
        )
        yield self.pad(draw, side, y=0.05, can=0.15)

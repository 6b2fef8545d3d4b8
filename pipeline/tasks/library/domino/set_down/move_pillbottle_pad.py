"""move_pillbottle_pad: stand a pill bottle on a moving pad."""

from collections.abc import Iterator

from pipeline.tasks.contract import Draw, Limit, Placement, Region, by_name, register
from pipeline.tasks.library.domino.set_down.set_down import SetDown


@register
class MovePillbottlePad(SetDown):
    """Grasp a pill bottle and stand it on a small pad that moves.

    Success: The base of the bottle is within 3 cm (per axis) and 5 mm (height) of the pad's centre.
    The bottle is upright and rests on the pad, and both grippers are measured open. Tolerances and
    pad (8 cm) are the original's static ones. Its dynamic version allows 5 cm and 1.5 cm on a 10 cm
    pad.
    """

    target, manipulated = "pad", "bottle"
    up = above = 0.06
    limits = by_name(
        plane=Limit(0.03, 0.05),
        height=Limit(0.005, 0.015),
        tilt=Limit(0.26, unit="rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(pad=Limit((0.04, 0.04), (0.05, 0.05)))
    own_conditions = ("upright", "at_rest", "released")

    def layout(self, draw: Draw) -> Iterator[Placement]:
        side = draw.side()
        bottle = Region(x=(side * 0.05, side * 0.25), y=(-0.10, 0.10), yaw=(-3.14, 3.14))
        yield Placement("bottle", draw.one_of("pill_bottle"), bottle)
        pad = draw.one_of("pad", half=self.sizes["pad"].under(draw.rules), thickness=0.004)
        yield Placement(
            "pad",
            pad,
            Region(x=(side * 0.05, side * 0.25), y=(-0.20, 0.10)),
            gap=0.03,
            distances={"bottle": 0.10},
        )

"""place_shoe: set a shoe down on a moving mat, its toe to the left."""

from collections.abc import Iterator

import numpy as np

from pipeline.expert.actor import Actor, Skill
from pipeline.expert.scripts import set_down_on
from pipeline.poses import compose, inverse, yawed
from pipeline.tasks.contract import Draw, Limit, Placement, Region, by_name, register
from pipeline.tasks.library.domino.set_down.set_down import SetDown
from pipeline.tasks.outcome import Outcome, within

TO_THE_LEFT = yawed((0, 0, 0), np.pi)
"""The shoe in the mat's frame, toe towards -x."""


@register
class PlaceShoe(SetDown):
    """Grasp a shoe and set it down along a mat that moves, its toe to the left.

    Success: The origin of the shoe is within 5 cm along and 2 cm across the mat of the mat's
    centre, its toe within 0.14 rad of left. The shoe rests upright on the mat, and both grippers
    are measured open. The tolerances are the original's static ones (5 x 2 cm, 0.07 per quaternion
    component); its dynamic ones are 8 x 4 cm. The original measures from a fixed point of the
    table; this follows the mat. The mat's family draws its size; the original enlarges it for the
    dynamic version. Regions are those of the original's dynamic version (shoe: any yaw, 25 cm or
    more from the origin), but shoe and mat stay apart.
    """

    step_limit = 500
    target, manipulated = "mat", "shoe"
    limits = by_name(
        along=Limit(0.05, 0.08),
        across=Limit(0.02, 0.04),
        height=Limit(0.015),
        angle=Limit(0.14, 0.2988, "rad"),
        tilt=Limit(0.26, 0.2988, "rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(mat=Limit(None, (0.16, 0.07)))
    own_conditions = ("at_height", "on_mat", "at_rest", "released")

    def layout(self, draw: Draw) -> Iterator[Placement]:
        side = draw.side()
        shoe = Region(
            x=(side * 0.22, side * 0.25),
            y=(-0.10, 0.05),
            yaw=(-np.pi, np.pi),
            away_from_origin=0.25,
        )
        yield Placement("shoe", draw.one_of("shoe"), shoe)
        yield Placement(
            "mat",
            draw.one_of("mat", half=self.sizes["mat"].under(draw.rules)),
            Region(x=(-0.20, 0.20), y=(-0.15, -0.05)),
        )

    def meet(self, a: Actor) -> Iterator[Skill]:
        return set_down_on(a, a.arms["arm"], "shoe", compose(a.frame("mat", "centre"), TO_THE_LEFT))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x, y, z, w, _, _, s = compose(
            inverse(compose(o.frame("mat", "centre"), TO_THE_LEFT)), o.frame("shoe", "base")
        )
        return {
            "centred": within((x, y), (limit["along"], limit["across"])),
            "at_height": within(z, limit["height"]),
            "aligned": within(2 * np.arctan2(s, abs(w)), limit["angle"]),
            "upright": o.upright("shoe", limit["tilt"]),
            **o.resting("shoe", "mat"),
            "grippers_open": o.grippers_open(),
        }

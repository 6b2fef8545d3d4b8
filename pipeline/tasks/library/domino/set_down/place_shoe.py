import numpy as np

from pipeline.expert.scripts import set_down_on
from pipeline.poses import compose, inverse, yawed
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Skills,
    by_name,
    register,
    within,
)

from .set_down import SetDown

TO_THE_LEFT = yawed((0, 0, 0), np.pi)  # the shoe in the mat's frame, toe towards -x


@register
class PlaceShoe(SetDown):
    """Grasp a shoe and set it down along a mat that moves, its toe to the left."""

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

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place(
            "shoe",
            x=(side * 0.22, side * 0.25),
            y=(-0.10, 0.05),
            yaw=(-np.pi, np.pi),
            away_from_origin=0.25,
        )
        half = self.sizes["mat"].under(draw.rules)
        yield draw.place("mat", half=half, x=(-0.20, 0.20), y=(-0.15, -0.05))

    def meet(self, a: Actor) -> Skills:
        return set_down_on(a, a.arms["arm"], "shoe", compose(a.frame("mat", "centre"), TO_THE_LEFT))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        goal = compose(o.frame("mat", "centre"), TO_THE_LEFT)
        x, y, z, w, _, _, s = compose(inverse(goal), o.frame("shoe", "base"))
        return {
            "centred": within((x, y), (limit["along"], limit["across"])),
            "at_height": within(z, limit["height"]),
            "aligned": within(2 * np.arctan2(s, abs(w)), limit["angle"]),
            "upright": o.upright("shoe", limit["tilt"]),
            **o.set_down("shoe", "mat"),
        }

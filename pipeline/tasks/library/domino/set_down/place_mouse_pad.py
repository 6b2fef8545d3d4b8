import numpy as np

from pipeline.tasks.contract import (
    ANY_YAW,
    Bodies,
    Draw,
    Limit,
    Outcome,
    by_name,
    register,
    within,
)

from .set_down import SetDown

EITHER_WAY = tuple(turn + lean for lean in (0.0, 0.1, -0.1) for turn in (0.0, np.pi))


@register
class PlaceMousePad(SetDown):
    """Grasp a computer mouse and set it down along a pad that moves, buttons to either end."""

    target, manipulated = "pad", "mouse"
    yaws = EITHER_WAY
    limits = by_name(
        along_x=Limit(0.015, 0.023),
        along_y=Limit(0.012, 0.020),
        angle=Limit(0.3, 0.365, "rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(pad=Limit((0.035, 0.065), (0.043, 0.073)))
    own_conditions = ("on_pad", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x, y = (side * 0.05, side * 0.25), (-0.20, 0.0)
        yield draw.place("mouse", x=x, y=y, yaw=ANY_YAW)
        yield self.pad(draw, x=x, y=y, gap=0.03, distances={"mouse": 0.10})

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        base, centre = o.frame("mouse", "base"), o.frame("pad", "centre")
        return {
            "centred": within(o.offset(base, centre)[:2], (limit["along_x"], limit["along_y"])),
            "aligned": o.orientation_error(base, centre, turns=2) < limit["angle"],
            **o.set_down("mouse", "pad"),
        }

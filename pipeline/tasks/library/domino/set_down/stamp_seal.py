from pipeline.tasks.contract import (
    ANY_YAW,
    Bodies,
    Body,
    Draw,
    Limit,
    Outcome,
    by_name,
    register,
    side_of,
    within,
)

from .set_down import SetDown


@register
class StampSeal(SetDown):
    """Grasp a stamp by its handle and press it upright onto a small pad that moves."""

    target, manipulated = "pad", "stamp"
    up = 0.06
    limits = by_name(
        plane=Limit(0.01),
        height=Limit(0.01),
        distance=Limit(0.035),
        tilt=Limit(0.26, 0.942, "rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(pad=Limit((0.035, 0.035), (0.045, 0.045)))
    own_conditions = ("centred", "at_height", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("stamp", "seal", x=(0.0, 0.0), y=(0.0, 0.0), yaw=ANY_YAW)
        x, y = (0.0, side * 0.25), (-0.15, 0.15)
        yield self.pad(draw, x=x, y=y, away_from_origin=0.10, gap=0.03)

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["pad"])}

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        d = o.offset(o.frame("stamp", "base"), o.frame("pad", "centre"))
        return {
            "centred": within(d[:2], limit["plane"]),
            "at_height": within(d[2], limit["height"]),
            "at_distance": bool(d @ d < limit["distance"] ** 2),
            "upright": o.upright("stamp", limit["tilt"]),
            **o.set_down("stamp", "pad"),
        }

from pipeline.tasks.contract import ANY_YAW, Bodies, Draw, Limit, Outcome, by_name, register, within

from .set_down import SetDown


@register
class PlaceEmptyCup(SetDown):
    """Grasp an empty cup and stand it on a coaster that moves."""

    step_limit = 500
    target, manipulated = "coaster", "cup"
    limits = by_name(
        plane=Limit(0.035), height=Limit(0.015), tilt=Limit(0.26, unit="rad"), lift=Limit(0.03)
    )
    own_conditions = ("upright", "on_coaster", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("cup", x=(side * 0.15, side * 0.30), y=(-0.20, 0.05), yaw=ANY_YAW)
        yield draw.place(
            "coaster", x=(side * -0.05, side * 0.10), y=(-0.20, 0.05), distances={"cup": 0.10}
        )

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x, y, z = o.offset(o.frame("cup", "base"), o.frame("coaster", "centre"))
        return {
            "centred": bool(x * x + y * y < limit["plane"] ** 2),
            "at_height": within(z, limit["height"]),
            "upright": o.upright("cup", limit["tilt"]),
            **o.set_down("cup", "coaster"),
        }

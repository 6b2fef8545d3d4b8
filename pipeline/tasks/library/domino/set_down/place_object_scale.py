from pipeline.tasks.contract import ANY_YAW, Bodies, Draw, Limit, Outcome, by_name, register

from .set_down import SetDown


@register
class PlaceObjectScale(SetDown):
    """Grasp a mouse, stapler or bell and set it down on a scale that moves."""

    target, manipulated = "scale", "object"
    limits = by_name(plane=Limit(0.035), below=Limit(0.01), lift=Limit(0.03))
    own_conditions = ("on_scale", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x, y = (side * 0.02, side * 0.25), (-0.20, 0.05)
        yield draw.place("object", "mouse", "stapler", "bell", x=x, y=y, yaw=ANY_YAW)
        yield draw.place("scale", x=x, y=y, yaw=ANY_YAW, distances={"object": 0.15})

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x, y, z = o.offset(o.frame("object", "base"), o.frame("scale", "centre"))
        return {
            "centred": bool(x * x + y * y < limit["plane"] ** 2),
            "at_height": bool(z > -limit["below"]),
            **o.resting("object", "scale"),
            "gripper_open": o.gripper_open(arms["arm"]),
        }

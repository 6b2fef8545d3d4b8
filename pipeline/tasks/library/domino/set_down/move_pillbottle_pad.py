from pipeline.tasks.contract import ANY_YAW, Bodies, Draw, Limit, by_name, register

from .set_down import SetDown


@register
class MovePillbottlePad(SetDown):
    """Grasp a pill bottle and stand it on a small pad that moves."""

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

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x = (side * 0.05, side * 0.25)
        yield draw.place("bottle", "pill_bottle", x=x, y=(-0.10, 0.10), yaw=ANY_YAW)
        yield self.pad(draw, x=x, y=(-0.20, 0.10), gap=0.03, distances={"bottle": 0.10})

import numpy as np

from pipeline.tasks.contract import ANY_YAW, Bodies, Draw, Limit, by_name, register

from .set_down import SetDown

EITHER_WAY = (0.0, np.pi)


@register
class MoveStaplerPad(SetDown):
    """Grasp a stapler and set it down along the long side of a pad that moves, its mouth to either
    end."""

    target, manipulated = "pad", "stapler"
    yaws, turns = EITHER_WAY, 2
    limits = by_name(
        plane=Limit(0.02, 0.025),
        height=Limit(0.01, 0.015),
        angle=Limit(0.06, unit="rad"),
        lift=Limit(0.03),
    )
    sizes = by_name(pad=Limit((0.055, 0.03), (0.065, 0.035)))
    own_conditions = ("on_pad", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        x, y = (side * 0.05, side * 0.25), (-0.20, 0.0)
        yield draw.place("stapler", x=x, y=y, yaw=ANY_YAW)
        yield self.pad(draw, x=x, y=y, gap=0.03, distances={"stapler": 0.10})

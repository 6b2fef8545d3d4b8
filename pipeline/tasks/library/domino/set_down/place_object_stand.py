import numpy as np

from pipeline.tasks.contract import Bodies, Draw, Limit, by_name, register

from .set_down import SetDown


@register
class PlaceObjectStand(SetDown):
    """Grasp a small object and set it down on the plate of a display stand that moves."""

    target, manipulated = "stand", "object"
    onto, up, above = "top", 0.12, 0.07
    limits = by_name(plane=Limit(0.03), height=Limit(0.015), lift=Limit(0.03))
    own_conditions = ("at_height", "on_stand", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        kinds = ("mouse", "stapler", "bell", "rubiks_cube", "toy_car", "remote")
        x, yaw = (side * 0.20, side * 0.28), (-np.pi / 3, np.pi / 3)
        yield draw.place("object", *kinds, x=x, y=(-0.05, 0.05), yaw=yaw)
        yield draw.place(
            "stand",
            "display_stand",
            x=(0.0, side * 0.05),
            y=(-0.15, -0.10),
            yaw=(-np.pi / 6, np.pi / 6),
            distances={"object": 0.10},
        )

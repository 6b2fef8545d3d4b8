from pipeline.motion.wrapped import CARRIED
from pipeline.tasks.contract import ANY_YAW, Bodies, Body, Draw, register

from .named import look_of, row
from .pick_named import PickNamed


@register
class PickRipe(PickNamed):
    """Grasp the only ripe one of three tomatoes that ride on a belt, and lift it.

    Success: as `pick_named`."""

    target = manipulated = "tomato"
    motion, movers = "conveyor", {"second": CARRIED, "third": CARRIED}

    def layout(self, draw: Draw) -> Bodies:
        middle = draw.side() * draw.uniform(0.08, 0.18), draw.uniform(-0.20, -0.05)
        places = draw.several(row(middle, draw.uniform(-0.3, 0.3), 0.12, 3).tolist(), 3)
        looks = ("ripe", "unripe", "unripe")
        for name, (x, y), ripeness in zip(("tomato", *self.movers), places, looks, strict=True):
            yield draw.place(name, "tomato", ripeness=ripeness, x=(x, x), y=(y, y), yaw=ANY_YAW)

    def choices(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"choice": look_of(bodies["tomato"], "ripeness")}

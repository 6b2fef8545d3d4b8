from pipeline.motion.wrapped import CARRIED
from pipeline.tasks.contract import ANY_YAW, Bodies, Body, Draw, Outcome, register
from pipeline.tasks.library.beyond.take.pick_from_belt import PickFromBelt

from .named import COLOURS, look_of, others_left, row


@register
class PickNamed(PickFromBelt):
    """Grasp the block of the colour asked for, while two others move too, and lift it.

    Success: the acting arm holds it off the table; no hand has held another."""

    target = manipulated = "block"
    motion, movers = "planar", {"second": "planar", "third": "planar"}

    def layout(self, draw: Draw) -> Bodies:
        named, *colours = draw.several(COLOURS, 3)
        where = {"x": (-0.22, 0.22), "y": (-0.18, 0.0), "yaw": (-0.7, 0.7)}
        yield draw.place("block", colour=named, away_from_centre=0.05, **where)
        for name, colour in zip(self.movers, colours, strict=True):
            yield draw.place(
                name,
                "block",
                colour=colour,
                x=(-0.26, 0.26),
                y=(-0.16, 0.10),
                yaw=(-0.7, 0.7),
                distances=dict.fromkeys(("block", "second"), 0.15),
            )

    def choices(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"choice": look_of(bodies[self.target])}

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return super().success(o, arms) | others_left(o, self.movers)


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

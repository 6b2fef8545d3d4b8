from pipeline.motion.wrapped import CARRIED
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Body,
    Draw,
    Outcome,
    Skills,
    Task,
    Workspace,
    by_name,
    register,
    side_of,
)

from .named import COLOURS, drop_in, look_of, row, take


@register
class SortTwoBelt(Task):
    """Take two blocks off one belt, one with each arm, and drop each into the basket on the side
    that is asked for its colour.

    Success: each lies in its basket, released."""

    category = "interception"
    step_limit = 800
    target = "block"
    motion, movers = "conveyor", {"other": CARRIED}
    workspace = Workspace(-0.35, 0.35, -0.25, 0.05)
    own_conditions = ()
    subgoals = by_name(first=("first_in_basket",), second=("second_in_basket",))

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        for name, where in (("basket", side), ("other_basket", -side)):
            x, y = (where * 0.22, where * 0.28), (0.10, 0.16)
            yield draw.place(name, "bread_basket", x=x, y=y, yaw=(1.2, 1.9), fixed=True)
        middle = draw.uniform(-0.05, 0.05), draw.uniform(-0.20, -0.10)
        places = draw.several(row(middle, draw.uniform(-0.25, 0.25), 0.15, 2).tolist(), 2)
        colours = draw.several(COLOURS, 2)
        for name, (x, y), colour in zip(("block", "other"), places, colours, strict=True):
            yield draw.place(name, "block", colour=colour, x=(x, x), y=(y, y), yaw=(-0.7, 0.7))

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["basket"]), "other_arm": side_of(bodies["other_basket"])}

    def choices(self, bodies: dict[str, Body]) -> dict[str, str]:
        names = ("left", "right") if side_of(bodies["basket"]) == "left" else ("right", "left")
        return dict(zip(names, map(look_of, (bodies["block"], bodies["other"])), strict=True))

    def meet(self, a: Actor) -> Skills:
        yield take(a, a.arms["arm"], "block", "basket")

    def finish(self, a: Actor) -> Skills:
        yield from drop_in(a, a.arms["arm"], "basket")
        yield take(a, a.arms["other_arm"], "other", "other_basket")
        yield from drop_in(a, a.arms["other_arm"], "other_basket")

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "first_in_basket": o.lies_in("block", "basket"),
            "second_in_basket": o.lies_in("other", "other_basket"),
            "released": not (o.handled("block") or o.handled("other")),
        }

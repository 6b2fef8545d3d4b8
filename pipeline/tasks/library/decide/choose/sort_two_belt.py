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


@register
class TakeTurnsBelts(SortTwoBelt):
    """Take a block off each of two belts, one arm after the other, and drop both into one basket.
    The colour that is asked for is first.

    Success: both lie in the basket, released; the second was not held before the first was in."""

    motion, movers = "conveyor", {"other": "conveyor"}

    def layout(self, draw: Draw) -> Bodies:
        x, y = (-0.03, 0.03), (0.08, 0.14)
        yield draw.place("basket", "bread_basket", x=x, y=y, yaw=(-0.2, 0.2), fixed=True)
        side, colours = draw.side(), draw.several(COLOURS, 2)
        for name, where, colour in zip(("block", "other"), (side, -side), colours, strict=True):
            x, y = (where * 0.14, where * 0.24), (-0.20, -0.05)
            yield draw.place(name, "block", colour=colour, x=x, y=y, yaw=(-0.7, 0.7))

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["block"]), "other_arm": side_of(bodies["other"])}

    def choices(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"first": look_of(bodies["block"]), "second": look_of(bodies["other"])}

    def meet(self, a: Actor) -> Skills:
        yield take(a, a.arms["arm"], "block", "basket", self._aside(a, "arm"))

    def finish(self, a: Actor) -> Skills:
        yield from drop_in(a, a.arms["arm"], "basket", self._aside(a, "arm"))
        aside = self._aside(a, "other_arm")
        yield take(a, a.arms["other_arm"], "other", "basket", aside)
        yield from drop_in(a, a.arms["other_arm"], "basket", aside)

    def _aside(self, a: Actor, role: str) -> float:
        return -0.045 if a.arms[role] == "left" else 0.045

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        held = o.first_held("other")
        before = o if held is None else o.until(held + 1)
        return {
            "first_in_basket": o.lies_in("block", "basket"),
            "second_in_basket": o.lies_in("other", "basket"),
            "in_turn": before.lies_in("block", "basket"),
            "released": not (o.handled("block") or o.handled("other")),
        }

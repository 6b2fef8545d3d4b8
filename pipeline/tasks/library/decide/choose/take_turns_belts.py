from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Body,
    Draw,
    Outcome,
    Skills,
    register,
    side_of,
)

from .named import COLOURS, drop_in, look_of, take
from .sort_two_belt import SortTwoBelt


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

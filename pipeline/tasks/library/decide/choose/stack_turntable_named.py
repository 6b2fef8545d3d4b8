from pipeline.expert.scripts import let_go, set_down_on
from pipeline.expert.skills import ROUND, home
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Body,
    Draw,
    Limit,
    Outcome,
    Skills,
    Task,
    by_name,
    register,
    within,
)

from .named import COLOURS, look_of, others_left


@register
class StackTurntableNamed(Task):
    """Stack two of three blocks on a coaster that a turntable carries round, in the order that is
    asked for.

    Success: the first rests on the coaster, the second on it, both released; the third was left."""

    category = "tracking"
    step_limit = 800
    target, manipulated = "coaster", "block"
    motion = "turntable"
    limits = by_name(plane=Limit(0.03), height=Limit(0.01), lift=Limit(0.03))
    own_conditions = ()
    subgoals = by_name(first=("on_coaster", "centred"), second=("second_on_block",))

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("coaster", x=(side * 0.02, side * 0.10), y=(-0.16, -0.02))
        colours = draw.several(COLOURS, 3)
        for name, colour in zip(("block", "second", "third"), colours, strict=True):
            yield draw.place(
                name,
                "block",
                colour=colour,
                x=(side * 0.20, side * 0.34),
                y=(-0.22, 0.10),
                yaw=(-0.7, 0.7),
                distances={"coaster": 0.16, "block": 0.12, "second": 0.12},
                shown=True,
            )

    def choices(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"first": look_of(bodies["block"]), "second": look_of(bodies["second"])}

    def meet(self, a: Actor) -> Skills:
        return set_down_on(a, a.arms["arm"], "block", a.frame("coaster", "centre"), ROUND)

    def finish(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        yield from let_go(arm)
        yield home(arm)
        yield from set_down_on(a, arm, "second", a.frame("block", "top"), ROUND)
        yield from let_go(arm)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        base = o.offset(o.frame("block", "base"), o.frame("coaster", "centre"))
        top = o.offset(o.frame("second", "base"), o.frame("block", "top"))
        return {
            "centred": within(base[:2], limit["plane"]),
            **o.resting("block", "coaster"),
            "second_on_block": within(top[:2], limit["plane"])
            and within(top[2], limit["height"])
            and o.touching("second", "block"),
            "second_released": not o.handled("second"),
            **others_left(o, ["third"]),
        }

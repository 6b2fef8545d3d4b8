"""place_bread_basket: lay bread in a moving bread basket."""

from collections.abc import Iterator

from pipeline.expert.actor import Actor, Skill
from pipeline.expert.scripts import set_down_on
from pipeline.expert.skills import ROUND, lift, open_
from pipeline.motion.workspace import Workspace
from pipeline.tasks.contract import TRACKING, Draw, Placement, Region, Task, register, side_of
from pipeline.tasks.outcome import Outcome, within
from pipeline.world.body import Body


@register
class PlaceBreadBasket(Task):
    """Grasp a piece of bread and lay it in a bread basket that moves.

    Success: bread within 5 cm (plane, per axis, as in the original) of the middle of the basket, resting on the basket and not on
    the table, both grippers measured open. One piece of bread, as in the original's dynamic version, at every level.
    """

    category = TRACKING
    step_limit = 700
    target, manipulated = "basket", "bread"
    workspace = Workspace(-0.35, 0.35, -0.15, 0.25)

    def layout(self, draw: Draw) -> Iterator[Placement]:
        side = draw.side()
        bread = Region(x=(side * 0.15, side * 0.27), y=(-0.20, 0.05), yaw=(-0.8, 0.8))
        yield Placement("bread", draw.one_of("bread"), bread)
        basket = Region(x=(-0.25, 0.25), y=(-0.05, 0.15), yaw=(-3.14, 3.14))
        yield Placement("basket", draw.one_of("bread_basket"), basket)

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["bread"])}

    def meet(self, a: Actor) -> Iterator[Skill]:
        return set_down_on(a, a.arms["arm"], "bread", a.frame("basket", "inside"), ROUND, up=0.12, above=0.08, opening=0.02)

    def finish(self, a: Actor) -> Iterator[Skill]:
        yield open_(a.arms["arm"], by=0.02)
        yield lift(a.arms["arm"], 0.10)
        yield open_(a.arms["arm"])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        d = o.offset(o.frame("bread", "base"), o.frame("basket", "inside"))
        return {
            "centred": within(d[:2], 0.05),
            "off_table": not o.touching("bread", "table"),
            **o.resting("bread", "basket"),
            "grippers_open": o.grippers_open(),
        }

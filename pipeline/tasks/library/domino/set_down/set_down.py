from collections.abc import Sequence
from typing import Any, ClassVar

from pipeline.expert.scripts import let_go, set_down_on
from pipeline.expert.skills import ROUND
from pipeline.tasks.contract import Actor, Draw, Outcome, Placement, Skills, Task, within


class SetDown(Task):
    """The manipulated body is set down with its base on the frame `onto` of the target, turned by
    one of `yaws`.

    `up` and `above` are those of `set_down_on`. The conditions follow from the limits there are:
    "plane" (m, per axis) and "height" of the base over that frame; "angle" between the two, as good
    after each of `turns` equal parts of a turn; "tilt" of the body."""

    onto: ClassVar[str] = "centre"
    yaws: ClassVar[Sequence[float]] = ROUND
    turns: ClassVar[int] = 1
    up: ClassVar[float] = 0.10
    above: ClassVar[float] = 0.10

    def pad(self, draw: Draw, **where: Any) -> Placement:
        half = self.sizes["pad"].under(draw.rules)
        return draw.place("pad", half=half, thickness=0.004, **where)

    def meet(self, a: Actor) -> Skills:
        goal = a.frame(self.target, self.onto)
        return set_down_on(
            a, a.arms["arm"], self.manipulated, goal, self.yaws, up=self.up, above=self.above
        )

    def finish(self, a: Actor) -> Skills:
        return let_go(a.arms["arm"])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        base, goal = o.frame(self.manipulated, "base"), o.frame(self.target, self.onto)
        d = o.offset(base, goal)
        found = {"centred": within(d[:2], limit["plane"])}
        if "height" in limit:
            found["at_height"] = within(d[2], limit["height"])
        if "angle" in limit:
            found["aligned"] = o.orientation_error(base, goal, self.turns) < limit["angle"]
        if "tilt" in limit:
            found["upright"] = o.upright(self.manipulated, limit["tilt"])
        return found | o.set_down(self.manipulated, self.target)

from typing import ClassVar

from pipeline.expert.actor import Skill
from pipeline.expert.skills import close, home, lift, press
from pipeline.tasks.contract import (
    ANY_YAW,
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Skills,
    Task,
    Workspace,
    by_name,
    register,
)


class Press(Task):
    """The closed fingers of the acting arm press the target at its frame `part`, near it by the
    limits "plane" and "height" (m)."""

    category = "tracking"
    part: ClassVar[str] = "button"

    def pressing(self, a: Actor) -> Skill:
        return press(
            a.arms["arm"], a.frame(self.target, self.part), body=self.target, part=self.part
        )

    def meet(self, a: Actor) -> Skills:
        yield close(a.arms["arm"])
        yield self.pressing(a)

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.06)
        yield home(a.arms["arm"])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return o.press(arms["arm"], self.target, self.part, self.under(o.rules))


@register
class ClickAlarmclock(Press):
    """Press the button of a moving alarm clock with the closed fingers of the arm beside it."""

    target = "clock"
    workspace = Workspace(-0.40, 0.40, -0.30, 0.20)
    limits = by_name(plane=Limit(0.027), height=Limit(0.027))

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place(
            "clock",
            "alarm_clock",
            x=(-0.21, 0.21),
            y=(-0.20, 0.10),
            yaw=ANY_YAW,
            away_from_centre=0.05,
        )


@register
class ClickBell(Press):
    """Press the button of a moving bell with the closed fingers of the arm beside it."""

    target = "bell"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(plane=Limit(0.02), height=Limit(0.024))

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("bell", x=(-0.21, 0.21), y=(-0.20, 0.10), away_from_centre=0.05)


@register
class PressStapler(Press):
    """Press the arm of a moving stapler near its mouth with the closed fingers of the arm beside
    it."""

    target, part = "stapler", "press"
    workspace = Workspace(-0.35, 0.35, -0.20, 0.20)
    limits = by_name(plane=Limit(0.027, 0.03), height=Limit(0.027, 0.03))
    own_conditions = ("closed_at_press",)

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("stapler", x=(-0.20, 0.20), y=(-0.10, 0.05), yaw=ANY_YAW)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        sides = o.log.sides if o.rules.name == "domino" else (arms["arm"],)
        presses = [o.press(side, "stapler", "press", self.under(o.rules)) for side in sides]
        return {name: any(found[name] for found in presses) for name in presses[0]}

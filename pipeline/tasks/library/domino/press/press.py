from typing import ClassVar

from pipeline.expert.actor import Skill
from pipeline.expert.skills import close, home, lift, press
from pipeline.tasks.contract import Actor, Outcome, Skills, Task


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

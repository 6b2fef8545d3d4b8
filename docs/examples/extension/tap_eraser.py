"""tap_eraser: tap a moving board eraser with closed fingers."""

from collections.abc import Iterator

from pipeline.expert.actor import Actor, Skill
from pipeline.expert.skills import close, home, lift, press
from pipeline.motion.workspace import Workspace
from pipeline.tasks.contract import (
    TRACKING,
    Draw,
    Limit,
    Placement,
    Region,
    Task,
    by_name,
    register,
    side_of,
)
from pipeline.tasks.outcome import Outcome
from pipeline.world.physics.body import Body


@register
class TapEraser(Task):
    """Tap the back of a moving eraser with the closed fingers of the arm beside it."""

    category = TRACKING
    target = "eraser"
    motion = "spinning"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(plane=Limit(0.03), height=Limit(0.024))
    least_seen, least_unseen = 2, 1
    seen = ("Tap {eraser} with {arm}.", "Use {arm} to tap the top of {eraser}.")
    unseen = ("Give {eraser} a light tap with {arm}.",)

    def layout(self, draw: Draw) -> Iterator[Placement]:
        region = Region(x=(-0.2, 0.2), y=(-0.15, 0.05), away_from_centre=0.08)
        yield Placement("eraser", draw.one_of("eraser"), region)

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["eraser"])}

    def meet(self, a: Actor) -> Iterator[Skill]:
        yield close(a.arms["arm"])
        yield press(a.arms["arm"], a.frame("eraser", "top"), body="eraser", part="top")

    def finish(self, a: Actor) -> Iterator[Skill]:
        yield lift(a.arms["arm"], 0.06)
        yield home(a.arms["arm"])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return o.press(arms["arm"], "eraser", "top", self.under(o.rules))

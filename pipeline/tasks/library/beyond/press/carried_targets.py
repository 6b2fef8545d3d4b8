from pipeline.expert.actor import Skill
from pipeline.expert.skills import track
from pipeline.tasks.contract import Actor, Workspace, register
from pipeline.tasks.library.domino.press.press import ClickBell, PressStapler


@register
class PressCirclingStapler(PressStapler):
    """Press the arm of a stapler that moves on a circle, the closed fingers moving with it until
    they touch."""

    motion = "circle"

    def pressing(self, a: Actor) -> Skill:
        return track(a.arms["arm"], super().pressing(a))


@register
class RingPushedBell(ClickBell):
    """Press the button of a bell that a paddle has pushed, the closed fingers moving with the bell
    until they touch."""

    motion = "pushed"

    def pressing(self, a: Actor) -> Skill:
        return track(a.arms["arm"], super().pressing(a))


@register
class RingTurningBell(ClickBell):
    """Press the button of a bell that a turntable carries round with the closed fingers of the arm
    beside it."""

    motion = "turntable"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.25)

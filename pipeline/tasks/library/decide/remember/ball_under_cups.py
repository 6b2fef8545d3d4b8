import numpy as np

from pipeline.expert.skills import grasp, lift, pause
from pipeline.motion.wrapped import CARRIED
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Placement,
    Region,
    Skills,
    Task,
    by_name,
    register,
)

WATCHED = 1.2  # s for which the arms stay at home: the ball is under a cup by then


@register
class BallUnderCups(Task):
    """Watch a ball roll under one of two equal cups, which change places on a turntable, and lift
    the cup that hides it.

    Success: a hand holds that cup above where they met, and the other cup was never touched."""

    category = "interception"
    target = "cup"
    motion, movers = "shuffle", {"other": CARRIED}
    limits = by_name(rise=Limit(0.05))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        cup = draw.one_of("shell_cup")
        x, y = draw.side() * draw.uniform(0.10, 0.16), draw.uniform(-0.14, -0.06)
        apart, angle = draw.uniform(0.08, 0.10), draw.uniform(-np.pi, np.pi)
        for name, sign in (("cup", 1), ("other", -1)):
            dx, dy = sign * apart * np.cos(angle), sign * apart * np.sin(angle)
            spot = Region(x=(x + dx, x + dx), y=(y + dy, y + dy))
            yield Placement(name, cup, spot)

    def meet(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], WATCHED)
        yield grasp(a.arms["arm"], "cup")

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.10)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "held": any(o.holds(side, "cup") for side in o.log.sides),
            "lifted": o.rise("cup") > self.under(o.rules)["rise"],
            "other_untouched": not any(o.touched(side, "other") for side in o.log.sides),
        }

from pipeline.expert.skills import grasp, lift, shake
from pipeline.tasks.contract import (
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
from pipeline.world.objects.families.goods.bottles import BODY


@register
class ShakeBottle(Task):
    """Catch a moving bottle, lift it, swing it from side to side three times and hold it upright
    again."""

    step_limit = 700
    target = "bottle"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(
        rise=Limit(0.05, 0.015),
        tilt=Limit(0.35, unit="rad"),
        swing=Limit(0.4, unit="rad"),
        times=Limit(4, unit=""),
    )
    own_conditions = ("held", "upright", "shaken")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("bottle", x=(-0.25, 0.25), y=(-0.20, -0.05), yaw=(-0.79, 0.79))

    def meet(self, a: Actor) -> Skills:
        yield grasp(a.arms["arm"], "bottle", kinds=BODY, pitch=0.3)

    def finish(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        yield lift(arm, 0.12)
        yield shake(arm, times=6)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        return {
            "held": o.holds(arms["arm"], "bottle"),
            "lifted": o.rise("bottle") > limit["rise"],
            "upright": o.upright("bottle", limit["tilt"]),
            "shaken": o.swings("bottle", limit["swing"]) >= limit["times"],
        }

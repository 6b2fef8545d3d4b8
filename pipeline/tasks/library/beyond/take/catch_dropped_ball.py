from pipeline.expert.skills import ROUND, grasp, lift, pause, place, resting_poses
from pipeline.tasks.contract import (
    TABLE_TOP,
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
    within,
)


@register
class CatchDroppedBall(Task):
    """Grasp a skillet and bring it from below to where a ball that a carrier drops will be."""

    step_limit = 500
    target, manipulated, falls = "ball", "skillet", "ball"
    motion = "drop"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.20)
    limits = by_name(plane=Limit(0.08), height=Limit(0.03))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        side, z = draw.side(), TABLE_TOP + draw.uniform(0.14, 0.19)
        yield draw.place("skillet", x=(side * 0.15, side * 0.25), y=(-0.12, 0.05), yaw=(-0.5, 0.5))
        yield draw.place(
            self.target,
            self.falls,
            x=(side * 0.06, side * 0.16),
            y=(-0.18, -0.05),
            z=z,
            distances={"skillet": 0.10},
            gap=0.0,
        )

    def meet(self, a: Actor) -> Skills:
        arm, ball = a.arms["arm"], a.pose(self.target)
        goals = [resting_poses(a.frames("skillet")["centre"], ball)]
        yield grasp(arm, "skillet", kinds=("handle",), goals=goals)
        yield lift(arm, 0.03)
        yield place(arm, "centre", ball, yaws=ROUND, above=0.07, press=0.01, out=(0, 0, -1))

    def finish(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], 0.6)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        d = o.offset(o.pose(self.target), o.frame("skillet", "centre"))
        return {
            "inside": within(d[:2], limit["plane"]) and within(d[2], limit["height"]),
            "held": o.holds(arms["arm"], "skillet"),
            "off_table": not o.touching("skillet", "table"),
        }


@register
class CatchDroppedBread(CatchDroppedBall):
    """Grasp a skillet and bring it from below to where a piece of bread that a carrier drops will
    be."""

    target = falls = "bread"

from pipeline.expert.scripts import let_go, set_down_on
from pipeline.expert.skills import ROUND, pause
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Skills,
    Task,
    by_name,
    register,
)

WATCHED = 1.5  # s for which the arm stays at home: the cup passes the first time


@register
class LidPassingCup(Task):
    """Grasp a lid and put it on a cup that passes, turns back inside a hood, and passes again on
    another lane.

    Success: the lid lies level on the middle of the upright cup, released."""

    category = "tracking"
    step_limit = 500
    target, manipulated = "cup", "lid"
    motion = "twice"
    limits = by_name(plane=Limit(0.02), height=Limit(0.012), lift=Limit(0.03))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("lid", x=(side * 0.22, side * 0.30), y=(-0.20, 0.0), shown=True)
        x = (side * 0.02, side * 0.10)
        yield draw.place("cup", x=x, y=(-0.18, 0.0), distances={"lid": 0.16})

    def meet(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], WATCHED)
        yield from set_down_on(a, a.arms["arm"], "lid", a.frame("cup", "top"), ROUND)

    def finish(self, a: Actor) -> Skills:
        return let_go(a.arms["arm"])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            **o.seated("lid", o.frame("cup", "top"), self.under(o.rules)),
            "level": o.upright("lid"),
            "cup_upright": o.upright("cup"),
            "released": not o.handled("lid"),
            "gripper_open": o.gripper_open(arms["arm"]),
        }

from pipeline.data.names import SIDES
from pipeline.expert.skills import grasp, lift, together
from pipeline.tasks.contract import (
    Actor,
    Bodies,
    Body,
    Draw,
    Limit,
    Outcome,
    Skills,
    Task,
    Workspace,
    by_name,
    register,
)


@register
class GrabRoller(Task):
    """Catch a moving rolling pin at both ends at the same time and lift it level."""

    target = "roller"
    workspace = Workspace(-0.35, 0.35, -0.30, 0.10)
    limits = by_name(rise=Limit(0.06, 0.05))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("roller", x=(-0.15, 0.15), y=(-0.25, -0.05), yaw=(-0.8, 0.8))

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"left": "left", "right": "right"}

    def meet(self, a: Actor) -> Skills:
        yield together(
            *(grasp(side, "roller", kinds=(f"{side}_end",), pitch=1.0) for side in SIDES)
        )

    def finish(self, a: Actor) -> Skills:
        yield together(lift("left", 0.12), lift("right", 0.12))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        return {
            "held_by_left": o.holds(arms["left"], "roller"),
            "held_by_right": o.holds(arms["right"], "roller"),
            "grippers_closed": all(o.closes(side) for side in arms.values()),
            "lifted": o.rise("roller") > limit["rise"],
        }

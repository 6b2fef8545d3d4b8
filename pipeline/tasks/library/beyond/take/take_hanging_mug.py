from pipeline.expert.skills import grasp, shift
from pipeline.tasks.contract import (
    ANY_YAW,
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
)


@register
class TakeHangingMug(Task):
    """Grasp a mug that hangs over the table on a cord, and draw it away from the cord."""

    target = "mug"
    motion = "pendulum"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(distance=Limit(0.06))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        z = TABLE_TOP + draw.uniform(0.06, 0.12)
        yield draw.place(
            "mug",
            x=(-0.25, 0.25),
            y=(-0.20, -0.05),
            yaw=ANY_YAW,
            away_from_centre=0.05,
            z=z,
            borne=True,
        )

    def meet(self, a: Actor) -> Skills:
        yield grasp(a.arms["arm"], "mug", kinds=("side",))

    def finish(self, a: Actor) -> Skills:
        yield shift(a.arms["arm"], (0.0, -0.10, 0.0))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "held": o.holds(arms["arm"], "mug"),
            "taken_away": o.travel("mug") > self.under(o.rules)["distance"],
            "off_table": not o.touching("mug", "table"),
        }

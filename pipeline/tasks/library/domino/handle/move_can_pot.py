import numpy as np

from pipeline.expert.skills import upright_goal
from pipeline.poses import Pose
from pipeline.tasks.contract import (
    TABLE_TOP,
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Workspace,
    by_name,
    register,
    sign_of,
    within,
)

from .set_aside import SetAside


@register
class MoveCanPot(SetAside):
    """Catch a moving sauce can and stand it on the table beside the pot, on the side of the arm
    that caught it."""

    target = "can"
    standoff = above = 0.06
    workspace = Workspace(-0.35, 0.35, -0.10, 0.20)
    limits = by_name(
        far=Limit(0.20),
        across=Limit(0.035),
        tilt=Limit(0.26, 0.2618, "rad"),
        height=Limit(0.001),
        lift=Limit(0.03),
    )
    own_conditions = ("on_table", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("pot", x=(0.0, 0.0), y=(0.0, 0.0), yaw=(-np.pi / 8, np.pi / 8))
        yield draw.place(
            "can",
            "sauce_can",
            x=(-0.30, 0.30),
            y=(0.05, 0.15),
            yaw=(-0.79, 0.79),
            away_from_centre=0.20,
            distances={"pot": 0.30},
        )

    def goal(self, a: Actor) -> Pose:
        x, y, _ = a.pose("pot")[:3]
        return upright_goal((x + 0.18 * sign_of(a.arms["arm"]), y, TABLE_TOP))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        dx, dy, _ = o.offset(o.pose("can"), o.pose("pot"))
        return {
            "on_arm_side": bool(sign_of(arms["arm"]) * dx > 0),
            "at_distance": within(dx, limit["far"]),
            "in_line": within(dy, limit["across"]),
            "upright": o.upright("can", limit["tilt"]),
            "at_height": bool(o.pose("can")[2] - o.pose("pot", 0)[2] < limit["height"]),
            **o.set_down("can", "table"),
        }

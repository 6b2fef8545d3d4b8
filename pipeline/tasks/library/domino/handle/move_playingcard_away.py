from pipeline.expert.skills import upright_goal
from pipeline.poses import Pose
from pipeline.tasks.contract import (
    ANY_YAW,
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
)

from .set_aside import SetAside


@register
class MovePlayingcardAway(SetAside):
    """Catch a moving deck of cards near the middle of the table and set it down far out on the side
    of the arm."""

    target = "cards"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(out=Limit(0.23), tilt=Limit(0.26, unit="rad"), lift=Limit(0.02))
    own_conditions = ("on_arm_side", "upright", "on_table", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place(
            "cards",
            "playing_cards",
            x=(-0.10, 0.10),
            y=(-0.20, 0.05),
            yaw=ANY_YAW,
            away_from_centre=0.05,
        )

    def goal(self, a: Actor) -> Pose:
        return upright_goal((0.27 * sign_of(a.arms["arm"]), -0.08, TABLE_TOP))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x = o.pose("cards")[0]
        return {
            "far_out": bool(abs(x) > limit["out"]),
            "on_arm_side": bool(sign_of(arms["arm"]) * x > 0),
            "upright": o.upright("cards", limit["tilt"]),
            **o.set_down("cards", "table"),
        }

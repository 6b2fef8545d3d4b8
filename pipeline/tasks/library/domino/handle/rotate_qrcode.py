import numpy as np

from pipeline.expert.scripts import let_go
from pipeline.expert.skills import grasp, lift, place, resting_poses, upright_goal
from pipeline.poses import lifted
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
    sign_of,
    within,
)


@register
class RotateQrcode(Task):
    """Catch a moving QR code sign, turn it and stand it beside the arm so that the code faces the
    robot."""

    target = "sign"
    workspace = Workspace(-0.35, 0.35, -0.20, 0.15)
    limits = by_name(
        plane=Limit(0.05), angle=Limit(0.14, 0.1415, "rad"), height=Limit(0.01), lift=Limit(0.03)
    )
    own_conditions = ("centred", "on_table", "at_rest", "released", "was_lifted")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place(
            "sign",
            "qr_sign",
            x=(-0.20, 0.20),
            y=(-0.20, 0.0),
            yaw=(-0.7, 0.7),
            away_from_centre=0.05,
        )

    def meet(self, a: Actor) -> Skills:
        goals = resting_poses(a.frames("sign")["base"], self._goal(a.arms), (0.0,))
        yield grasp(a.arms["arm"], "sign", goals=[goals, lifted(goals, 0.07)], standoff=0.06)

    def finish(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        yield lift(arm, 0.07)
        yield place(arm, "base", self._goal(a.arms), above=0.07)
        yield from let_go(arm)

    def _goal(self, arms: dict[str, str]) -> np.ndarray:
        """Pose (7,) of the sign, which faces the robot at yaw 0."""
        return upright_goal((0.20 * sign_of(arms["arm"]), -0.15, TABLE_TOP))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        goal, sign = self._goal(arms), o.pose("sign")
        return {
            "centred": within(o.offset(sign, goal)[:2], limit["plane"]),
            "aligned": o.orientation_error(sign, goal) < limit["angle"],
            "at_height": bool(sign[2] < TABLE_TOP + limit["height"]),
            **o.set_down("sign", "table"),
        }

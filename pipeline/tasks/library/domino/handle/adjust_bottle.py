from itertools import product

import numpy as np

from pipeline.expert.skills import carry, grasp, lift, resting_poses, upright_goal
from pipeline.poses import quat_rotate
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
)

CLEARANCES = (0.05, 0.10, 0.15, 0.22)
"""M under the foot of the raised bottle: thick wrists need more."""


@register
class AdjustBottle(Task):
    """Catch a bottle that lies on its side, its cap towards the middle of the table, and hold it
    with the cap up."""

    target = "bottle"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(
        out=Limit(0.15), cap=Limit(0.16), tilt=Limit(0.26, unit="rad"), foot=Limit(0.02)
    )
    own_conditions = ("upright", "above_table", "held")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        inwards = 0.0 if side < 0 else np.pi
        yield draw.place(
            "bottle",
            "lying_bottle",
            x=(side * 0.08, side * 0.12),
            y=(-0.13, -0.08),
            yaw=(inwards - 0.4, inwards + 0.4),
        )

    def meet(self, a: Actor) -> Skills:
        yield grasp(a.arms["arm"], "bottle", goals=[self._raised(a)])

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.10)
        yield carry(a.arms["arm"], self._raised(a))

    def _raised(self, a: Actor) -> np.ndarray:
        """Poses (N,7) of the bottle: upright, out on the arm's side."""
        cap, out = a.frames("bottle")["cap"], sign_of(a.arms["arm"])
        z = TABLE_TOP + 2 * cap[0]
        places = product(CLEARANCES, (0.19, 0.23), (-0.12, -0.05))
        spots = [upright_goal((out * x, y, z + foot)) for foot, x, y in places]
        return resting_poses(cap, spots)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        cap = o.frame("bottle", "cap")
        up = quat_rotate(cap[3:], [0, 0, 1.0])
        foot = cap[:3] - 2 * o.bodies["bottle"].instance.frames()["cap"][0] * up
        return {
            "upright": bool(up[2] > np.cos(limit["tilt"])),
            "on_arm_side": bool(sign_of(arms["arm"]) * cap[0] > limit["out"]),
            "cap_above_table": bool(cap[2] > TABLE_TOP + limit["cap"]),
            "above_table": bool(foot[2] > TABLE_TOP + limit["foot"]),
            "held": o.holds(arms["arm"], "bottle"),
        }

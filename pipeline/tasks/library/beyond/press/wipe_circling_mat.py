import numpy as np

from pipeline.expert.skills import ROUND, first_of, grasp, lift, place, resting_poses, shift, track
from pipeline.poses import inverse, transform
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
    sign_of,
)

STROKE = 0.08  # m


@register
class WipeCirclingMat(Task):
    """Grasp a block, bring it down on a mat that moves on a circle, at the mat's velocity, and draw
    it across."""

    target, manipulated = "mat", "block"
    motion = "circle"
    limits = by_name(stroke=Limit(0.05), lift=Limit(0.03))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place(
            "block", "wooden_block", x=(side * 0.26, side * 0.32), y=(-0.20, 0.0), yaw=(-0.7, 0.7)
        )
        x, half = (side * 0.02, side * 0.10), (0.10, 0.08)
        yield draw.place("mat", half=half, x=x, y=(-0.18, 0.0), distances={"block": 0.18})

    def meet(self, a: Actor) -> Skills:
        arm, onto = a.arms["arm"], a.frame("mat", "centre")
        yield grasp(arm, "block", goals=[resting_poses(a.frames("block")["base"], onto)])
        yield lift(arm, 0.08)
        yield track(arm, place(arm, "base", onto, yaws=ROUND, press=0.001))

    def finish(self, a: Actor) -> Skills:
        arm, sign = a.arms["arm"], sign_of(a.arms["arm"])
        ways = (sign, 0, 0), (-sign, 0, 0), (0, -1, 0), (0, 1, 0)
        yield first_of(*(shift(arm, STROKE * np.array(way)) for way in ways))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        frames = sorted({int(row["frame"]) for row in o.contacts("block", "mat")})
        way = [transform(inverse(o.pose("mat", k)), o.pose("block", k)[:3]) for k in frames]
        far = max((float(np.linalg.norm(place - way[0])) for place in way), default=0.0)
        return {"wiped": far > self.under(o.rules)["stroke"], "held": o.holds(arms["arm"], "block")}

from pipeline.expert.skills import ROUND, grasp, lift, place, resting_poses
from pipeline.tasks.contract import (
    TABLE_TOP,
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
    side_of,
    within,
)


@register
class BeatBlockHammer(Task):
    """Take the hammer and bring its face down on the top of a block that moves."""

    target, manipulated = "block", "hammer"
    workspace = Workspace(-0.35, 0.35, -0.15, 0.25)
    limits = by_name(plane=Limit(0.02, 0.04), strike_height=Limit(0.02, 0.017), lift=Limit(0.02))
    own_conditions = ("held",)

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("hammer", x=(0.0, 0.0), y=(-0.06, -0.06), yaw=(1.4, 1.7))
        yield draw.place("block", x=(-0.25, 0.25), y=(-0.05, 0.15), yaw=(-0.5, 0.5))

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["block"])}

    def meet(self, a: Actor) -> Skills:
        arm, top = a.arms["arm"], a.frame("block", "top")
        goals = resting_poses(a.frames("hammer")["base"], top)
        yield grasp(arm, "hammer", goals=[goals], pitch=1.1)
        yield lift(arm, 0.10)
        yield place(arm, "base", top, yaws=ROUND, above=0.07, press=0.004, speed=0.3)

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.05)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        hits = [int(frame) for frame in o.contacts("hammer", "block")["frame"]]
        limit = self.under(o.rules)
        least = TABLE_TOP + limit["strike_height"]
        faces = ((o.frame("hammer", "base", k), o.frame("block", "top", k)) for k in hits)
        over = (within(o.offset(*pair)[:2], limit["plane"]) for pair in faces)
        centred = [frame for frame, is_over in zip(hits, over, strict=True) if is_over]
        return {
            "block_struck": bool(hits),
            "strike_centred": bool(centred),
            "lifted_at_strike": any(bool(o.pose("hammer", k)[2] > least) for k in centred),
            "held": o.holds(arms["arm"], "hammer"),
        }

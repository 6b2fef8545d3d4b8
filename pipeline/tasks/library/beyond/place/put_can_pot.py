from pipeline.expert.scripts import let_go
from pipeline.expert.skills import (
    ROUND,
    carry,
    grasp,
    in_turn,
    lift,
    open_,
    pause,
    place,
    resting_poses,
    track,
)
from pipeline.poses import lifted
from pipeline.tasks.contract import (
    ANY_YAW,
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Skills,
    Task,
    by_name,
    register,
    within,
)


@register
class PutCanPot(Task):
    """Grasp a can and set it down inside a pot that a turntable carries round, the hand moving with
    the pot until they touch."""

    target, manipulated = "pot", "can"
    motion = "turntable"
    limits = by_name(plane=Limit(0.07), height=Limit(0.03), lift=Limit(0.03))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("can", "can", "pill_bottle", x=(side * 0.24, side * 0.30), y=(-0.20, 0.0))
        yield draw.place(
            "pot",
            x=(side * 0.02, side * 0.10),
            y=(-0.18, 0.0),
            yaw=ANY_YAW,
            distances={"can": 0.18},
        )

    def meet(self, a: Actor) -> Skills:
        arm, inside = a.arms["arm"], a.frame("pot", "inside")
        yield grasp(arm, "can", goals=[resting_poses(a.frames("can")["base"], inside)])
        yield lift(arm, 0.10)
        yield track(arm, place(arm, "base", inside, yaws=ROUND, opening=0.01))

    def finish(self, a: Actor) -> Skills:
        return let_go(a.arms["arm"])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        d = o.offset(o.frame(self.manipulated, "base"), o.frame(self.target, "inside"))
        return {
            "inside": within(d[:2], limit["plane"]) and within(d[2], limit["height"]),
            f"{self.target}_upright": o.upright(self.target),
            "released": not o.handled(self.manipulated),
            "grippers_open": o.grippers_open(),
        }


ABOVE = 0.03  # m over the rim from which the ball is dropped


@register
class DropBallSwayingBowl(PutCanPot):
    """Grasp a ball, hold it over a bowl that moves along a wave, at the bowl's velocity, and let it
    fall in."""

    target, manipulated = "bowl", "ball"
    motion = "sinusoid"
    limits = by_name(plane=Limit(0.05), height=Limit(0.04), lift=Limit(0.03))

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("ball", "play_ball", x=(side * 0.24, side * 0.30), y=(-0.20, 0.0))
        yield draw.place(
            "bowl",
            x=(side * 0.02, side * 0.12),
            y=(-0.18, 0.0),
            yaw=ANY_YAW,
            distances={"ball": 0.16},
        )

    def meet(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        over = resting_poses(a.frames("ball")["base"], lifted(a.frame("bowl", "top"), ABOVE))
        yield grasp(arm, "ball", goals=[over])
        yield lift(arm, 0.10)
        yield track(arm, in_turn(carry(arm, over), open_(arm), pause(arm, 0.2)))

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.06)
        yield pause(a.arms["arm"], 0.3)

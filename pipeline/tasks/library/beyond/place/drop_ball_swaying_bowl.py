from pipeline.expert.actor import Actor, Skills
from pipeline.expert.candidates import lifted
from pipeline.expert.skills import (
    ROUND,
    carry,
    grasp,
    in_turn,
    lift,
    open_,
    pause,
    resting_poses,
    track,
)
from pipeline.tasks.contract import Bodies, Draw, Limit, Placement, Region, by_name, register

from .put_can_pot import PutCanPot

ABOVE = 0.03  # m over the rim from which the ball is dropped


@register
class DropBallSwayingBowl(PutCanPot):
    """Grasp a ball, hold it over a bowl that moves along a wave, at the bowl's velocity, and let it
    fall in.

    Success: the ball lies in the middle of the upright bowl, released."""

    target, manipulated = "bowl", "ball"
    motion = "sinusoid"
    limits = by_name(plane=Limit(0.05), height=Limit(0.04), lift=Limit(0.03))

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield Placement(
            "ball", draw.one_of("play_ball"), Region(x=(side * 0.24, side * 0.30), y=(-0.20, 0.0))
        )
        bowl = Region(x=(side * 0.02, side * 0.12), y=(-0.18, 0.0), yaw=(-3.14, 3.14))
        yield Placement("bowl", draw.one_of("bowl"), bowl, distances={"ball": 0.16})

    def meet(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        over = resting_poses(a.frames("ball")["base"], lifted(a.frame("bowl", "top"), ABOVE), ROUND)
        yield grasp(arm, "ball", goals=[list(over)])
        yield lift(arm, 0.10)
        yield track(arm, in_turn(carry(arm, over), open_(arm), pause(arm, 0.2)))

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.06)
        yield pause(a.arms["arm"], 0.3)

from pipeline.expert.skills import ROUND, grasp, lift, place, resting_poses
from pipeline.tasks.contract import ANY_YAW, Actor, Bodies, Draw, Skills, register

from .basket import IntoBasket


@register
class PlaceCanBasket(IntoBasket):
    """Catch a moving can, put it in the basket, and lift the basket by its handle with the other
    arm."""

    target = "can"

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("basket", x=(side * -0.02, side * 0.02), y=(-0.08, -0.05))
        yield draw.place("can", x=(side * 0.20, side * 0.25), y=(0.0, 0.10), yaw=ANY_YAW)

    def meet(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        goals = resting_poses(a.frames("can")["base"], a.frame("basket", arm))
        yield grasp(arm, "can", goals=[goals], pitch=0.8)

    def finish(self, a: Actor) -> Skills:
        arm, lifter = a.arms["arm"], a.arms["lifter"]
        yield lift(arm, 0.15)
        goal = a.frame("basket", arm)
        yield place(arm, "base", goal, yaws=ROUND, above=0.10, press=0.0, opening=0.025)
        yield from self.release(arm, lifter, 0.025)

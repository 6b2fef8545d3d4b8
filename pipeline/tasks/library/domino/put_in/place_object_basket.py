import numpy as np

from pipeline.expert.skills import grasp, lift, place, resting_poses
from pipeline.poses import lifted
from pipeline.tasks.contract import Actor, Bodies, Draw, Skills, register

from .basket import IntoBasket

DROP = 0.055  # m over the basket's floor: a slanting hand cannot go below the rim

SLACK = 0.012
"""Distance (m) by which the jaws let go in the basket: opened wider they wedge themselves in."""


@register
class PlaceObjectBasket(IntoBasket):
    """Catch a moving deck of cards or toy car, put it in the basket, and lift the basket by its
    handle with the other arm."""

    target = "object"

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("basket", x=(side * -0.02, side * -0.02), y=(-0.08, -0.05))
        yield draw.place(
            "object",
            "playing_cards",
            "toy_car",
            x=(side * 0.20, side * 0.25),
            y=(-0.10, 0.10),
            yaw=(-0.52, 0.52),
        )

    def meet(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        goals = resting_poses(a.frames("object")["base"], a.frame("basket", arm), self._along(a))
        yield grasp(arm, "object", goals=[lifted(goals, DROP)], pitch=1.2)

    def finish(self, a: Actor) -> Skills:
        arm, lifter = a.arms["arm"], a.arms["lifter"]
        yield lift(arm, 0.15, least=0.4)
        goal = lifted(a.frame("basket", arm), DROP)
        yield place(arm, "base", goal, yaws=self._along(a), above=0.08, press=0.0, opening=SLACK)
        yield from self.release(arm, lifter, SLACK, least=0.2)

    def _along(self, a: Actor) -> tuple[float, ...]:
        x, y, _ = np.ptp(a.bodies["object"].instance.shape().aabb(), axis=0)
        turn = 0.0 if x > y else np.pi / 2
        return tuple(
            turn + half + off for off in (0.0, 0.2, -0.2, 0.4, -0.4) for half in (0.0, np.pi)
        )

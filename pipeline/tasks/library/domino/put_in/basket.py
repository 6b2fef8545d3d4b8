import numpy as np

from pipeline.expert.budgets import MOVE
from pipeline.expert.skills import ROUND, grasp, home, lift, open_, place, resting_poses, together
from pipeline.poses import lifted
from pipeline.tasks.contract import (
    ANY_YAW,
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
    other_side,
    register,
    side_of,
)


class IntoBasket(Task):
    """The target is caught by the `arm` beside it and put in the body "basket", which the `lifter`
    holds up."""

    step_limit = 700
    workspace = Workspace(-0.35, 0.35, -0.15, 0.25)
    limits = by_name(
        rise=Limit(0.02),
        tilt=Limit(1.047, unit="rad"),
        plane=Limit(0.10),
        sum=Limit(0.15),
        lift=Limit(0.03),
    )
    own_conditions = ("basket_held",)

    def release(
        self, arm: str, lifter: str, slack: float, least: float = MOVE.least_lift
    ) -> Skills:
        """Let the jaws go by `slack` m, draw out by the share `least`, and lift the basket."""
        yield open_(arm, by=slack)
        yield lift(arm, 0.16, least=least)
        yield together(home(arm), grasp(lifter, "basket", kinds=("handle",)))
        yield lift(lifter, 0.08)

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        arm = side_of(bodies[self.target])
        return {"arm": arm, "lifter": other_side(arm)}

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x, y, z = o.offset(o.pose(self.target), o.pose("basket"))
        return {
            "basket_lifted": o.rise("basket") > limit["rise"],
            "lifted": o.rise(self.target) > limit["rise"],
            "basket_upright": o.upright("basket", limit["tilt"]),
            "centred": bool(x * x + y * y < limit["plane"] ** 2),
            "at_distance": bool(abs(x) + abs(y) + abs(z) < limit["sum"]),
            "on_basket": o.touching(self.target, "basket"),
            "off_table": not o.touching(self.target, "table"),
            "basket_held": o.holds(arms["lifter"], "basket"),
        }


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

from pipeline.expert.budgets import MOVE
from pipeline.expert.skills import grasp, home, lift, open_, together
from pipeline.tasks.contract import (
    Body,
    Limit,
    Outcome,
    Skills,
    Task,
    Workspace,
    by_name,
    other_side,
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

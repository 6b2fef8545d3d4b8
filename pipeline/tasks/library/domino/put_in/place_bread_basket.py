import numpy as np

from pipeline.expert.candidates import leading_grasps
from pipeline.expert.scripts import place_or_regrasp, regrasp
from pipeline.expert.skills import ROUND, grasp, in_turn, lift, open_, resting_poses
from pipeline.poses import Pose, lifted
from pipeline.tasks.contract import (
    ANY_YAW,
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
)

DROPS = (0.0, 0.03, 0.06)  # m above the floor at which the bread may be let go, the lowest in reach

SLACK = 0.016
"""Distance (m) by which the jaws let go in the basket: opened wider they wedge themselves in."""


@register
class PlaceBreadBasket(Task):
    """Grasp a piece of bread and lay it in a bread basket that moves."""

    step_limit = 700
    target, manipulated = "basket", "bread"
    workspace = Workspace(-0.35, 0.35, -0.15, 0.25)
    limits = by_name(plane=Limit(0.05), lift=Limit(0.03))

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place(
            "bread", x=(side * 0.15, side * 0.27), y=(-0.20, 0.05), yaw=(-np.pi / 4, np.pi / 4)
        )
        yield draw.place(
            "basket",
            "bread_basket",
            x=(-0.25, 0.25),
            y=(-0.05, 0.15),
            yaw=ANY_YAW,
            distances={"bread": 0.10},
        )

    def meet(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        onto = self._within_reach(a)
        goals = self._goals(a, onto)
        yield from regrasp(a, arm, "bread", goals)
        yield grasp(arm, "bread", goals=goals)
        yield lift(arm, 0.12)
        # Bread that is let go above the basket meets it when it has fallen, so opening belongs to
        # the same skill.
        yield in_turn(
            place_or_regrasp(arm, "base", onto, yaws=ROUND, above=0.08, opening=SLACK),
            open_(arm, by=SLACK),
        )

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.10)
        yield open_(a.arms["arm"])

    def _within_reach(self, a: Actor) -> Pose:
        """Where the base of the bread is to be let go: on the floor of the basket, or as little
        above as the arm needs."""
        arm, grasps = a.arm_planner(a.arms["arm"]), a.frames("bread").grasps
        options = [lifted(a.frame("basket", "inside"), drop) for drop in DROPS]
        for onto in options:
            if len(leading_grasps(arm, "bread", grasps, self._goals(a, onto))) > 0:
                return onto
        return options[0]

    def _goals(self, a: Actor, onto: Pose) -> list[np.ndarray]:
        return [resting_poses(a.frames("bread")["base"], onto)]

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            **o.seated("bread", o.frame("basket", "inside"), self.under(o.rules)),
            "off_table": not o.touching("bread", "table"),
            **o.set_down("bread", "basket"),
        }

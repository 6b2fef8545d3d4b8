from itertools import product

import numpy as np

from pipeline.expert.scripts import let_go
from pipeline.expert.skills import ROUND, carry, grasp, hand_over, home, lift, open_, upright_goal
from pipeline.poses import compose, inverse, pose, quat_about, transform, yawed
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
    by_name,
    register,
    side_of,
    within,
)
from pipeline.world.objects.families.goods.bottles import BODY


@register
class PutBottlesDustbin(Task):
    """Catch a moving bottle and drop it into the dustbin beside the table, with the left arm. On
    the right the right arm catches it by its upper part and hands it over in the air."""

    step_limit = 1700
    target = "bottle"
    limits = by_name(
        outline_x=Limit(0.221),
        outline_y=Limit(0.325),
        least=Limit(0.005),
        depth=Limit(0.57),
        lift=Limit(0.03),
    )
    own_conditions = ("below_rim", "released", "was_lifted")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("dustbin", x=(-0.85, -0.84), y=(-0.15, -0.05), z=0.0, fixed=True)
        yield draw.place("bottle", x=(-0.25, 0.30), y=(0.03, 0.23), away_from_centre=0.05)

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["bottle"]), "dropper": "left"}

    def meet(self, a: Actor) -> Skills:
        arm, goals, kinds = "left", self._over_the_bin(a), BODY
        if a.arms["arm"] == "right":
            arm, goals, kinds = "right", self._exchange(), ("neck", "high")
        yield grasp(arm, "bottle", kinds=kinds, goals=[goals], pitch=0.4)

    def finish(self, a: Actor) -> Skills:
        if a.arms["arm"] == "right":
            yield lift("right", 0.10)
            goals = [self._over_the_bin(a)]
            yield hand_over("right", "left", self._exchange(), kinds=("low", "side"), goals=goals)
            yield from let_go("right")
            yield home("right")
        else:
            yield lift("left", 0.12)
        yield carry("left", self._over_the_bin(a))
        yield open_("left")

    def _exchange(self) -> np.ndarray:
        """Poses (N,7) of the bottle at which it may change hands, near the middle of the table."""
        spots = product(ROUND, (0.12, 0.16, 0.20), (-0.10, -0.05, -0.15), (0.0, -0.05, 0.05))
        return np.stack([upright_goal((x, y, TABLE_TOP + z), yaw) for yaw, z, y, x in spots])

    def _over_the_bin(self, a: Actor) -> np.ndarray:
        """Poses (N,7) of the bottle above the near half of the dustbin, upright or tilted."""
        x, y = a.pose("dustbin")[:2]
        leans = ((0, 1, 0), 0.0), ((0, 1, 0), -0.6), ((1, 0, 0), 0.6), ((1, 0, 0), -0.6)
        tilts = [pose((0, 0, 0), quat_about(axis, angle)) for axis, angle in leans]
        ways = product((0.10, 0.06), (-0.04, 0.0, 0.04), (0.08, 0.14), tilts, ROUND)
        spots = (((x + dx, y + dy, TABLE_TOP + z), tilt, yaw) for dx, dy, z, tilt, yaw in ways)
        return np.stack([compose(yawed(spot, yaw), tilt) for spot, tilt, yaw in spots])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x, y, z = transform(inverse(o.pose("dustbin")), o.pose("bottle")[:3])
        rim = o.bodies["dustbin"].instance.shape().aabb()[1]
        return {
            "within_outline": bool(np.hypot(x, y) < rim[0]),
            "in_bin": within((x, y), (limit["outline_x"], limit["outline_y"])),
            "below_rim": bool(z < rim[2]),
            "at_height": bool(limit["least"] < z < limit["depth"]),
            "released": not o.handled("bottle"),
        }

from itertools import product

import numpy as np

from pipeline.expert.candidates import hand_poses
from pipeline.expert.scripts import let_go
from pipeline.expert.skills import ROUND, carry, first_of, grasp, lift, place, resting_poses
from pipeline.poses import Pose, compose, lifted, yawed
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
    other_side,
    register,
    side_of,
    sign_of,
    within,
)

ABOVE = 0.07  # m over the pan from which the bread comes down

OFF_CENTRE = (0.0, 0.012, 0.022)  # m from the middle of the pan, away from its handle

JUDGED = 30  # places of the pan at which the way of the bread is looked at


@register
class PlaceBreadSkillet(Task):
    """Catch a moving piece of bread, lift the skillet by its handle with the other arm, and lay the
    bread in it."""

    step_limit = 500
    target = "bread"
    limits = by_name(plane=Limit(0.035, 0.10), rise=Limit(0.02, 0.01), lift=Limit(0.03))
    own_conditions = ("skillet_held", "on_skillet", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place(
            "skillet", x=(side * 0.15, side * 0.25), y=(-0.12, 0.05), yaw=(-np.pi / 6, np.pi / 6)
        )
        yield draw.place(
            "bread", x=(side * -0.28, side * -0.20), y=(-0.20, 0.05), yaw=(-np.pi / 4, np.pi / 4)
        )

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        pan = side_of(bodies["skillet"])
        return {"arm": other_side(pan), "pan_arm": pan}

    def meet(self, a: Actor) -> Skills:
        yield grasp(a.arms["arm"], "bread", pitch=1.3)

    def finish(self, a: Actor) -> Skills:
        arm, pan = a.arms["arm"], a.arms["pan_arm"]
        yield lift(arm, 0.12)
        held = self._held(pan)
        goals = [list(held)]
        grasps = (
            grasp(pan, "skillet", kinds=kinds, goals=goals, pitch=0.4)
            for kinds in (("handle",), None)
        )
        yield first_of(*grasps)
        yield lift(pan, 0.06)
        yield carry(pan, self._within_reach(a, held))
        yield place(arm, "base", self._spots(a, a.pose("skillet")), yaws=ROUND, above=ABOVE)
        yield from let_go(arm)

    def _held(self, pan: str) -> np.ndarray:
        """Poses (N,7) in which the skillet is held out: level, nearer to the middle of the
        table."""
        s, turns = sign_of(pan), (0.8, 1.2, 1.6, 0.4, 2.0, 0.0, -0.4)
        xs, ys = (0.10, 0.06, 0.14, 0.0, -0.06), (0.0, -0.06, 0.06, 0.12)
        spots = product((0.08, 0.06), turns, xs, ys)
        return np.stack([yawed((s * x, y, TABLE_TOP + z), s * turn) for z, turn, x, y in spots])

    def _spots(self, a: Actor, pan: Pose) -> np.ndarray:
        """Poses (N,7) for the bread in the skillet at the pose `pan`."""
        centre, shifts = a.frames("skillet")["centre"], (yawed((0, y, 0), 0) for y in OFF_CENTRE)
        return np.stack([compose(pan, compose(centre, shift)) for shift in shifts])

    def _within_reach(self, a: Actor, held: np.ndarray) -> np.ndarray:
        """The poses `held` (N,7) at which the other arm can come straight down to the pan; all of
        them if there is none."""
        arm, pan = a.arms["arm"], a.arms["pan_arm"]
        planner = a.arm_planner(arm)
        q, ok = a.arm_planner(pan).solve(hand_poses(a, pan, held))
        base = a.frames("bread")["base"]
        found = list[int]()
        reached = np.flatnonzero(ok)
        for i in reached[:: max(1, len(reached) // JUDGED)]:
            spots = resting_poses(base, self._spots(a, held[i]))
            over = lifted(hand_poses(a, arm, spots), ABOVE)
            at, solved = planner.solve(over)
            there = planner.within(planner.scene.expecting(pan, q[i]))
            touching = [("bread", "skillet"), (f"{arm}_fingers", "skillet")]
            free, apart = there.checker(), there.checker(touching)
            for k in np.flatnonzero(solved):
                line = planner.line(at[k], lifted(over[k], -ABOVE)) if free(at[k]) else None
                if line is not None and apart(line):
                    found.append(i)
                    break
            if len(found) == 4:
                break
        return held[found] if found else held

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        d = o.offset(o.frame("bread", "base"), o.frame("skillet", "centre"))
        return {
            "lifted": o.rise("bread") > limit["rise"],
            "skillet_lifted": o.rise("skillet") > limit["rise"],
            "skillet_held": o.holds(arms["pan_arm"], "skillet"),
            "centred": within(d[:2], limit["plane"]),
            **o.resting("bread", "skillet"),
        }

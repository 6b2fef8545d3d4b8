import numpy as np

from pipeline.expert.skills import ROUND, grasp, in_turn, lift, pause, pour, upright_goal
from pipeline.poses import Floats, compose, inverse, pose, quat_about, quat_multiply
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
)

BALLS = ((0.011, 0.0), (-0.011, 0.0))  # where the balls lie in the cup, x and y in its frame (m)

HEIGHTS, TILTS = (0.05, 0.09, 0.14), (2.3, 2.0, 1.8)
"""M of the cup's opening over the rim; rad down."""

LEVEL = 0.8  # rad; a hand that comes from above has its palm where the balls run out
FLIGHT = 0.03  # m from the opening at which the balls land, about


@register
class PourSwayingPot(Task):
    """Grasp a cup with two balls in it and pour them into a pot that moves along a wave."""

    category = "tracking"
    step_limit = 500
    target, manipulated = "pot", "ball_1"
    motion = "sinusoid"
    limits = by_name(lift=Limit(0.03))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place("cup", x=(side * 0.24, side * 0.30), y=(-0.20, 0.0), yaw=ANY_YAW)
        for i, (x, y) in enumerate(BALLS):
            yield draw.place(f"ball_{i + 1}", "ball", x=(x, x), y=(y, y), z=0.004, inside="cup")
        region = {"x": (side * 0.02, side * 0.10), "y": (-0.18, 0.0), "yaw": ANY_YAW}
        yield draw.place("pot", distances={"cup": 0.18}, **region)

    def meet(self, a: Actor) -> Skills:
        arm, over, tipped = a.arms["arm"], *self._poses(a)
        goals = [over[::5], tipped[::7]]
        yield grasp(arm, "cup", kinds=("side",), steepest=LEVEL, goals=goals)
        yield lift(arm, 0.10)
        # no `track`: a hand that tips the cup through a singularity of its wrist cannot move along
        yield in_turn(pour(arm, over, tipped, speed=0.8), pause(arm, 0.6))

    def finish(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], 0.8)

    def _poses(self, a: Actor) -> tuple[Floats, Floats]:
        """Poses (N,7) of the cup upright over the pot, and (M,7) with its opening there, turned
        down."""
        rim, out = a.frame("pot", "top")[:3], inverse(a.frames("cup")["top"])
        over, tipped = list[Floats](), list[Floats]()
        for height in HEIGHTS:
            for heading in ROUND:
                along = np.array([np.cos(heading), np.sin(heading), 0.0])
                spot = rim + np.array([0.0, 0.0, height]) - FLIGHT * along
                over += [upright_goal(spot - 0.04 * along, yaw) for yaw in ROUND]
                for tilt in TILTS:
                    down = quat_about((-along[1], along[0], 0), tilt)
                    tipped += [
                        compose(pose(spot, quat_multiply(down, upright_goal(spot, yaw)[3:])), out)
                        for yaw in ROUND
                    ]
        return np.stack(over), np.stack(tipped)

    def conditions(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        """Either ball may touch the pot first."""
        found = super().conditions(o, arms)
        if found.pop(f"met_by_{self.manipulated}", None) is not None:
            found["met_by_ball"] = o.met_by().startswith("ball_")
        return found

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "balls_in_pot": all(o.lies_in(f"ball_{i + 1}", "pot") for i in range(len(BALLS))),
            "pot_upright": o.upright("pot"),
            "cup_held": o.holds(arms["arm"], "cup"),
        }

from itertools import product

import numpy as np

from pipeline.expert.scripts import let_go
from pipeline.expert.skills import (
    grasp,
    hand_over,
    home,
    lift,
    place,
    resting_poses,
    together,
    upright_goal,
)
from pipeline.tasks.contract import (
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
)

QUARTERS = tuple(np.arange(0, 2 * np.pi, np.pi / 4).tolist())


@register
class HandoverBlock(Task):
    """Catch a long block with the left arm, hand it over in the air to the right arm, which stands
    it on a pad."""

    step_limit = 800
    target = "block"
    limits = by_name(
        plane=Limit(0.03), height=Limit(0.01), tilt=Limit(0.26, unit="rad"), lift=Limit(0.03)
    )
    own_conditions = ("upright", "on_pad", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("pad", x=(0.10, 0.25), y=(0.15, 0.20), fixed=True)
        yield draw.place("block", "long_block", x=(-0.25, -0.05), y=(0.0, 0.25), yaw=(-0.2, 0.2))

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"giver": "left", "receiver": "right"}

    def meet(self, a: Actor) -> Skills:
        goals = [self._exchange()]
        yield grasp(a.arms["giver"], "block", kinds=("high",), goals=goals, pitch=0.4)

    def finish(self, a: Actor) -> Skills:
        giver, receiver = a.arms["giver"], a.arms["receiver"]
        yield lift(giver, 0.10)
        centre = a.frame("pad", "centre")
        goals = [resting_poses(a.frames("block")["base"], centre, QUARTERS)]
        places = self._exchange()
        yield hand_over(giver, receiver, places, kinds=("low",), goals=goals, leading=40)
        yield from let_go(giver, 0.09)
        yield together(home(giver), lift(receiver, 0.03))
        yield place(receiver, "base", centre, yaws=QUARTERS)
        yield from let_go(receiver)

    def _exchange(self) -> np.ndarray:
        """Poses (N,7) of the block at which it may change hands, near the middle of the table."""
        spots = product(QUARTERS, (0.87, 0.83, 0.93), (-0.12, -0.05, 0.0), (0.0, -0.04, 0.04))
        return np.stack([upright_goal((x, y, z), yaw) for yaw, z, y, x in spots])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            **o.seated("block", o.frame("pad", "centre"), self.under(o.rules)),
            **o.resting("block", "pad"),
            "gripper_open": o.gripper_open(arms["receiver"]),
        }

from itertools import product

import numpy as np

from pipeline.expert.actor import Skill
from pipeline.expert.scripts import let_go
from pipeline.expert.skills import grasp, hand_over, lift
from pipeline.poses import yawed
from pipeline.tasks.contract import (
    ANY_YAW,
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
)

HELD_UP = 0.195  # m over the table of the head at the end
TURNS = (0.0, 0.4, -0.4, 0.8, -0.8)


@register
class HandoverMic(Task):
    """Catch a microphone by its tail with the arm beside it and hand it, head first, to the other
    arm."""

    step_limit = 600
    target = "microphone"
    limits = by_name(head=Limit(0.18), lift=Limit(0.03))
    own_conditions = ("released_by_giver", "held")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place(
            "microphone", x=(-0.30, 0.30), y=(-0.15, 0.05), yaw=ANY_YAW, away_from_centre=0.20
        )

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        giver = side_of(bodies["microphone"])
        return {"giver": giver, "receiver": other_side(giver)}

    def meet(self, a: Actor) -> Skills:
        giver = a.arms["giver"]
        goals = [list(self._exchange(giver))]
        yield grasp(giver, "microphone", kinds=("tail",), goals=goals, pitch=1.2)

    def finish(self, a: Actor) -> Skills:
        giver, receiver = a.arms["giver"], a.arms["receiver"]
        yield lift(giver, 0.10)
        yield self.passing(giver, receiver)
        yield from let_go(giver, 0.10)
        missing = TABLE_TOP + HELD_UP - a.frame("microphone", "head")[2]
        if missing > 0:
            yield lift(receiver, missing)

    def passing(self, giver: str, receiver: str) -> Skill:
        return hand_over(giver, receiver, self._exchange(giver), kinds=("neck",))

    def _exchange(self, giver: str) -> np.ndarray:
        """Poses (N,7) of the microphone at which it may change hands, its head to the receiver."""
        ahead = 0.0 if giver == "left" else np.pi
        spots = product((0.20, 0.15, 0.10), (-0.10, -0.05, -0.15), (0.0, -0.04, 0.04), TURNS)
        return np.stack([yawed((x, y, TABLE_TOP + z), ahead + turn) for z, y, x, turn in spots])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        giver, head = arms["giver"], o.frame("microphone", "head")
        return {
            "gripper_open": o.gripper_open(giver),
            "released_by_giver": not any(o.touching(f, "microphone") for f in o.fingers(giver)),
            "held": o.holds(arms["receiver"], "microphone"),
            "in_hand": o.handled("microphone"),
            "gripper_closed": o.closes(arms["receiver"]),
            "on_receiver_side": bool(sign_of(arms["receiver"]) * head[0] > 0),
            "above_table": bool(head[2] > TABLE_TOP + self.under(o.rules)["head"]),
        }

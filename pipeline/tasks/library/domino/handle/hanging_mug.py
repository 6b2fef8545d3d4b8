from itertools import product

import numpy as np

from pipeline.expert.scripts import let_go
from pipeline.expert.skills import grasp, home, lift, place, resting_poses, upright_goal
from pipeline.poses import frame, inverse, quat_rotate, transform
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
    within,
)

MIDDLE = (0.03, -0.15, TABLE_TOP)  # where the mug changes hands

TILTS = (0.0, -0.3, -0.6, -0.9)  # rad about the axis of the hole; negative ones raise the ear


@register
class HangingMug(Task):
    """Catch a moving mug with the left arm, set it down in the middle, and hang it on the rack's
    peg with the right arm."""

    step_limit = 900
    target = "mug"
    limits = by_name(axis=Limit(0.03), peg=Limit(0.05), hole=Limit(0.09), lift=Limit(0.03))
    own_conditions = ("on_peg_axis", "between_root_and_tip", "off_table", "released")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("rack", x=(0.10, 0.30), y=(0.13, 0.17), yaw=(-0.2, 0.2), fixed=True)
        x = draw.uniform(-0.25, -0.10)
        yield draw.place("mug", x=(x, x), y=(-0.05, 0.05 if x <= -0.15 else 0.0), yaw=(-1.57, 1.57))

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"catcher": "left", "hanger": "right"}

    def meet(self, a: Actor) -> Skills:
        goals = [[upright_goal(MIDDLE, yaw) for yaw in self._turns()]]
        yield grasp(a.arms["catcher"], "mug", kinds=("side", "rim"), goals=goals)

    def finish(self, a: Actor) -> Skills:
        catcher, hanger = a.arms["catcher"], a.arms["hanger"]
        yield lift(catcher, 0.08)
        yield place(catcher, "base", upright_goal(MIDDLE), yaws=self._turns())
        yield from let_go(catcher)
        yield home(catcher)
        hole = a.frames("mug")["handle_hole"]
        goals = [resting_poses(hole, self._on_the_peg(a), TILTS)]
        yield grasp(hanger, "mug", kinds=("side",), goals=goals, pitch=0.3)
        yield lift(hanger, 0.12)
        peg, out = self._on_the_peg(a), self._peg(a)
        yield place(
            hanger, "handle_hole", peg, yaws=TILTS, above=0.11, out=out, press=0.0, opening=0.03
        )
        yield from let_go(hanger, 0.12)

    def _turns(self) -> tuple[float, ...]:
        """Yaw angles in which the mug is set down: its ear to the left, away from the right
        hand."""
        return tuple(np.pi + off for off in (0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9))

    def _peg(self, a: Actor) -> np.ndarray:
        return quat_rotate(a.frame("rack", "peg")[3:], np.array([0.0, 0.0, 1.0]))

    def _on_the_peg(self, a: Actor) -> np.ndarray:
        """Poses (N,7) of the hole on the middle of the peg, ear to either side, the mug turned a
        little."""
        at, out = a.frame("rack", "peg_middle")[:3], self._peg(a)
        aside = np.arctan2(out[1], out[0]) - np.pi / 2
        turns = product((0.0, 0.25, -0.25, 0.5, -0.5), (0.0, np.pi))
        ears = (aside + turn + half for turn, half in turns)
        return np.stack([frame(at, (np.cos(e), np.sin(e), 0), (0, 0, -1)) for e in ears])

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit, tip = self.under(o.rules), o.frame("rack", "peg")
        hole = o.frame("mug", "handle_hole")
        local = transform(inverse(tip), hole[:3])
        beside = hole[:2] - (o.pose("rack")[:2] + tip[:2]) / 2
        root = transform(inverse(tip), o.frame("rack", "peg_middle")[:3])[2] * 2
        return {
            "on_peg_axis": bool(np.hypot(local[0], local[1]) < limit["axis"]),
            "between_root_and_tip": bool(root < local[2] < 0.0),
            "near_peg": within(beside, limit["peg"]),
            "above_table": bool(hole[2] > TABLE_TOP + limit["hole"]),
            "off_table": not o.touching("mug", "table"),
            "on_rack": o.touching("mug", "rack"),
            "released": not o.handled("mug"),
            "gripper_open": o.gripper_open(arms["hanger"]),
        }

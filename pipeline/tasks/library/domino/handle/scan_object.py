from itertools import product

import numpy as np

from pipeline.expert.skills import (
    ROUND,
    carry,
    face,
    first_of,
    grasp,
    lift,
    lift_clear,
    upright_goal,
)
from pipeline.poses import Pose, inverse, pose, quat_about, quat_multiply, quat_rotate, transform
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

FROM_CENTRE = (0.058, 0.052)  # m of the scanner's window from the middle of the box

TILTS = (0.0, 0.35, -0.35, 0.7)
"""Rad of the scanner about its level axis; positive ones make it look down."""

TURNS = (0.2, 0.4, 0.0, 0.6, -0.2, 0.8, -0.4, 1.0, 1.2, -0.6)
"""Rad from the scanner's side towards the box; positive ones look from nearer to the robot."""


@register
class ScanObject(Task):
    """Catch a moving tea box with the arm beside it, take the scanner with the other arm, and scan
    the box in the air."""

    step_limit = 500
    target = "box"
    limits = by_name(plane=Limit(0.025), far=Limit(0.07), rise=Limit(0.05), lift=Limit(0.03))
    own_conditions = ("held", "scanner_held", "lifted", "scanner_lifted")

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place(
            "scanner",
            x=(side * 0.05, side * 0.25),
            y=(-0.15, -0.05),
            yaw=(np.pi - 1.2, np.pi + 1.2),
        )
        yield draw.place(
            "box",
            "tea_box",
            x=(side * -0.25, side * -0.05),
            y=(-0.20, 0.0),
            yaw=(-1.2, 1.2),
            gap=0.05,
        )

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        arm = side_of(bodies["box"])
        return {"arm": arm, "scan_arm": other_side(arm)}

    def meet(self, a: Actor) -> Skills:
        yield grasp(a.arms["arm"], "box", goals=[self._shown(a.arms["arm"])])

    def finish(self, a: Actor) -> Skills:
        arm, scan = a.arms["arm"], a.arms["scan_arm"]
        yield lift(arm, 0.13)
        shown = self._shown(arm)
        yield carry(arm, shown)
        scans = self._scans(a, a.pose("box"))
        yield grasp(scan, "scanner", goals=[scans], pitch=0.3)
        yield lift_clear(scan, 0.10)
        yield first_of(carry(scan, scans), face(arm, shown, scan, lambda box: self._scans(a, box)))

    def _shown(self, arm: str) -> np.ndarray:
        """Poses (N,7) in which the box is held up, a little to the side of its arm."""
        s = sign_of(arm)
        spots = product((0.18, 0.14, 0.22), (0.0, 0.03, -0.03), (-0.03, -0.07), ROUND)
        return np.stack([upright_goal((s * x, y, TABLE_TOP + z), yaw) for z, x, y, yaw in spots])

    def _scans(self, a: Actor, box: Pose) -> np.ndarray:
        """Poses (N,7) of the scanner, nearly upright, its window before the middle of the box at
        pose `box`."""
        middle, window = self._middle(box, a.bodies), a.frames("scanner")["window"]
        s, found = sign_of(a.arms["scan_arm"]), []
        for distance, tilt, turn in product(FROM_CENTRE, TILTS, TURNS):
            heading = np.arctan2(0.0, -s) - s * turn
            upright = quat_about((0, 0, 1), heading + np.pi / 2)
            stands = quat_multiply(upright, quat_about((1, 0, 0), tilt))
            ahead = quat_rotate(stands, [0, -1.0, 0])  # the window looks along -y of the scanner
            found.append(pose(middle - distance * ahead - quat_rotate(stands, window[:3]), stands))
        return np.stack([p for p in found if p[2] > TABLE_TOP + 0.06])

    def _middle(self, box: Pose, bodies: dict[str, Body]) -> np.ndarray:
        return transform(box, bodies["box"].instance.frames()["top"][:3] / 2)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        middle = self._middle(o.pose("box"), dict(o.bodies))
        x, y, z = transform(inverse(o.frame("scanner", "window")), middle)
        return {
            "on_ray": within((x, y), limit["plane"]),
            "at_distance": bool(0 < z < limit["far"]),
            "grippers_closed": all(o.closes(side) for side in arms.values()),
            "held": o.holds(arms["arm"], "box"),
            "scanner_held": o.holds(arms["scan_arm"], "scanner"),
            "lifted": o.rise("box") > limit["rise"],
            "scanner_lifted": o.rise("scanner") > limit["rise"],
        }

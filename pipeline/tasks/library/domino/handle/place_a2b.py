from typing import ClassVar

import numpy as np

from pipeline.expert.skills import upright_goal
from pipeline.poses import Pose
from pipeline.tasks.contract import (
    ANY_YAW,
    TABLE_TOP,
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Placement,
    Region,
    Workspace,
    by_name,
    family_of,
    register,
    within,
)

from .set_aside import SetAside

KINDS = (
    *("mouse", "stapler", "bell", "toy_car", "rubiks_cube", "bread", "phone", "playing_cards"),
    *("wooden_block", "tea_box", "coffee_box", "soap"),
)
DISTANCE = 0.13
APART = 0.10  # m in y
NEAR = 0.19  # m; A nearer to B than this must not stand on the side it shall come to


class PlaceBeside(SetAside):
    """Object A moves, object B, of another kind, lies still. `direction` is -1 where A shall come
    to stand left of B, +1 right."""

    target = "a"
    workspace = Workspace(-0.35, 0.35, -0.30, 0.10)
    direction: ClassVar[int]
    limits = by_name(near=Limit(0.08), far=Limit(0.20), across=Limit(0.05), lift=Limit(0.03))
    own_conditions = ("on_table", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        b = draw.one_of(*KINDS)
        a = draw.one_of(*(kind for kind in KINDS if kind != family_of(b)))
        (ax, ay), (bx, by) = self.places(draw)
        yield Placement("b", b, Region(x=(bx, bx), y=(by, by), yaw=ANY_YAW))
        yield Placement("a", a, Region(x=(ax, ax), y=(ay, ay), yaw=ANY_YAW))

    def places(self, draw: Draw) -> tuple[tuple[float, float], tuple[float, float]]:
        """Positions of A and B by the law of the original: A anywhere, B 10 cm from it in y at
        least, both drawn again where A is about to be where it shall go already."""
        while True:
            a = draw.uniform(-0.22, 0.22), draw.uniform(-0.20, 0.0)
            side = 1 if a[0] > 0 else -1
            # B stands where its free side is in reach of the arm beside A: in the middle, or on A's
            # half beyond the goal
            xs = (-0.10, 0.10) if side == self.direction else sorted((side * 0.18, side * 0.23))
            b = draw.uniform(*xs), draw.uniform(-0.20, 0.0)
            while abs(a[1] - b[1]) < APART:
                b = draw.uniform(*xs), draw.uniform(-0.20, 0.0)
            dx, dy = a[0] - b[0], a[1] - b[1]
            if self.direction * dx < 0 or float(np.hypot(dx, dy)) > NEAR:
                return a, b

    def goal(self, a: Actor) -> Pose:
        x, y, _ = a.pose("b")[:3]
        return upright_goal((x + self.direction * DISTANCE, y, TABLE_TOP))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        dx, dy, _ = o.offset(o.pose("a"), o.pose("b"))
        return {
            "on_correct_side": bool(self.direction * dx > 0),
            "at_distance": bool(limit["near"] < (dx**2 + dy**2) ** 0.5 < limit["far"]),
            "in_line": within(dy, limit["across"]),
            **o.set_down("a", "table"),
        }


@register
class PlaceA2bLeft(PlaceBeside):
    """Catch object A while it moves and set it down on the table to the left of object B."""

    direction = -1


@register
class PlaceA2bRight(PlaceBeside):
    """Catch object A while it moves and set it down on the table to the right of object B."""

    direction = 1

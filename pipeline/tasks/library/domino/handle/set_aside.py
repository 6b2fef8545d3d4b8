from abc import abstractmethod
from typing import ClassVar

import numpy as np

from pipeline.expert.budgets import GRASP, PLACE
from pipeline.expert.scripts import let_go
from pipeline.expert.skills import ROUND, grasp, lift, place, resting_poses, upright_goal
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
    Skills,
    Task,
    Workspace,
    by_name,
    family_of,
    register,
    sign_of,
    within,
)


class SetAside(Task):
    """The target is caught and set down with its base at `goal`, turned to any side. `standoff` is
    that of `grasp`, `above` that of `place`."""

    standoff: ClassVar[float] = GRASP.standoff
    above: ClassVar[float] = PLACE.above

    @abstractmethod
    def goal(self, a: Actor) -> Pose:
        """World pose (7,) of the base."""

    def meet(self, a: Actor) -> Skills:
        goals = [resting_poses(a.frames(self.target)["base"], self.goal(a))]
        yield grasp(a.arms["arm"], self.target, goals=goals, standoff=self.standoff)

    def finish(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        yield lift(arm, 0.10)
        yield place(arm, "base", self.goal(a), yaws=ROUND, above=self.above)
        yield from let_go(arm)


@register
class MoveCanPot(SetAside):
    """Catch a moving sauce can and stand it on the table beside the pot, on the side of the arm
    that caught it."""

    target = "can"
    standoff = above = 0.06
    workspace = Workspace(-0.35, 0.35, -0.10, 0.20)
    limits = by_name(
        far=Limit(0.20),
        across=Limit(0.035),
        tilt=Limit(0.26, 0.2618, "rad"),
        height=Limit(0.001),
        lift=Limit(0.03),
    )
    own_conditions = ("on_table", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("pot", x=(0.0, 0.0), y=(0.0, 0.0), yaw=(-np.pi / 8, np.pi / 8))
        yield draw.place(
            "can",
            "sauce_can",
            x=(-0.30, 0.30),
            y=(0.05, 0.15),
            yaw=(-0.79, 0.79),
            away_from_centre=0.20,
            distances={"pot": 0.30},
        )

    def goal(self, a: Actor) -> Pose:
        x, y, _ = a.pose("pot")[:3]
        return upright_goal((x + 0.18 * sign_of(a.arms["arm"]), y, TABLE_TOP))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        dx, dy, _ = o.offset(o.pose("can"), o.pose("pot"))
        return {
            "on_arm_side": bool(sign_of(arms["arm"]) * dx > 0),
            "at_distance": within(dx, limit["far"]),
            "in_line": within(dy, limit["across"]),
            "upright": o.upright("can", limit["tilt"]),
            "at_height": bool(o.pose("can")[2] - o.pose("pot", 0)[2] < limit["height"]),
            **o.set_down("can", "table"),
        }


@register
class MovePlayingcardAway(SetAside):
    """Catch a moving deck of cards near the middle of the table and set it down far out on the side
    of the arm."""

    target = "cards"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(out=Limit(0.23), tilt=Limit(0.26, unit="rad"), lift=Limit(0.02))
    own_conditions = ("on_arm_side", "upright", "on_table", "at_rest", "released")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place(
            "cards",
            "playing_cards",
            x=(-0.10, 0.10),
            y=(-0.20, 0.05),
            yaw=ANY_YAW,
            away_from_centre=0.05,
        )

    def goal(self, a: Actor) -> Pose:
        return upright_goal((0.27 * sign_of(a.arms["arm"]), -0.08, TABLE_TOP))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        x = o.pose("cards")[0]
        return {
            "far_out": bool(abs(x) > limit["out"]),
            "on_arm_side": bool(sign_of(arms["arm"]) * x > 0),
            "upright": o.upright("cards", limit["tilt"]),
            **o.set_down("cards", "table"),
        }


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

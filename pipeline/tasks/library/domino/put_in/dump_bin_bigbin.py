from itertools import product

import numpy as np

from pipeline.expert.scripts import let_go
from pipeline.expert.skills import (
    ROUND,
    carry,
    first_of,
    grasp,
    home,
    lift,
    pause,
    place,
    pour,
    upright_goal,
)
from pipeline.poses import compose, inverse, pose, quat_about, quat_multiply, transform
from pipeline.tasks.contract import (
    TABLE_TOP,
    Actor,
    Bodies,
    Body,
    Draw,
    Limit,
    Outcome,
    Placement,
    Region,
    Skills,
    Task,
    by_name,
    register,
    side_of,
)

MIDDLE = (-0.04, -0.12, TABLE_TOP)  # where the right arm sets the bin down for the left one

BALLS = ((0.0, 0.0), (0.021, 0.0), (-0.021, 0.0), (0.0, 0.021), (0.0, -0.021))
"""Where the balls lie in the bin, x and y in its frame (m)."""

TILTS = (2.5, 2.2, 2.0)  # rad by which the bin is turned down

HELD_UP, FLIGHT = 0.31, 0.15  # m over the table at the end; m that the balls fly


@register
class DumpBinBigbin(Task):
    """Catch a moving table bin with five balls in it and pour them into the big bin with the left
    arm. The right arm sets a bin on the right down in the middle for the left one."""

    step_limit = 600
    target = "bin"
    limits = by_name(rise=Limit(0.26), depth=Limit(0.12))
    own_conditions = ("held",)

    def layout(self, draw: Draw) -> Bodies:
        big = draw.one_of("big_bin")
        out = -0.602 - float(big.shape().aabb()[1, 0])
        yield Placement("big_bin", big, Region(x=(out, out), y=(-0.12, -0.08), z=0.0), fixed=True)
        yield draw.place(
            "bin",
            "table_bin",
            x=(-0.20, 0.20),
            y=(-0.20, -0.05),
            yaw=(-0.37, 0.37),
            away_from_centre=0.05,
        )
        for i, (x, y) in enumerate(BALLS):
            yield draw.place(f"ball_{i + 1}", "ball", x=(x, x), y=(y, y), z=0.005, inside="bin")

    def arms(self, bodies: dict[str, Body]) -> dict[str, str]:
        return {"arm": side_of(bodies["bin"]), "pourer": "left"}

    def meet(self, a: Actor) -> Skills:
        between = [np.stack([upright_goal(MIDDLE, yaw) for yaw in ROUND])]
        goals = self._ends(a) if a.arms["arm"] == "left" else between
        yield grasp(a.arms["arm"], "bin", goals=goals, pitch=0.9)

    def finish(self, a: Actor) -> Skills:
        if a.arms["arm"] == "right":
            yield lift("right", 0.06)
            yield place("right", "base", upright_goal(MIDDLE), yaws=ROUND)
            yield from let_go("right")
            yield home("right")
            yield grasp("left", "bin", goals=self._ends(a), pitch=0.9)
        yield lift("left", 0.14)
        # the bin may turn in the hand, or a ball lie against the finger that is inside
        for _ in range(2):
            yield pour("left", self._over(a), self._tipped(a), speed=0.8)
            yield pause("left", 0.8)
            if all(a.pose(f"ball_{i + 1}")[2] < TABLE_TOP for i in range(len(BALLS))):
                break
        ways, z = product((-0.35, -0.5), (-0.1, 0, -0.2), ROUND), TABLE_TOP + HELD_UP
        raised = [upright_goal((x, y, z), yaw) for x, y, yaw in ways]
        # it may turn in the hand once more
        while (missing := TABLE_TOP + HELD_UP - a.pose("bin")[2]) > 0.03:
            whole, part = lift("left", missing, least=1.0), lift("left", missing)
            yield first_of(whole, carry("left", raised), part)

    def _spots(self, a: Actor) -> list[np.ndarray]:
        """Points (3,) above the near part of the big bin."""
        x, y = a.pose("big_bin")[:2]
        x += a.bodies["big_bin"].instance.shape().aabb()[1, 0] - 0.15
        ways = product((0.0, -0.08, 0.08), (0.16, 0.22))
        return [np.array([x, y + dy, TABLE_TOP + z]) for dy, z in ways]

    def _over(self, a: Actor) -> np.ndarray:
        return np.stack([upright_goal(spot, yaw) for spot in self._spots(a) for yaw in ROUND])

    def _tipped(
        self, a: Actor, spots: slice = slice(None), tilts: tuple[float, ...] = TILTS
    ) -> np.ndarray:
        """Poses (M,7) of the bin, its opening over the big bin, turned down to where the balls fall
        in."""
        out = inverse(a.frames("bin")["top"])
        reach = a.bodies["big_bin"].instance.shape().aabb()[1, :2] - 0.05
        poses = list[np.ndarray]()
        for spot in self._spots(a)[spots]:
            for heading in ROUND:
                along = np.array([np.cos(heading), np.sin(heading)])
                lands = (np.abs(spot[:2] + FLIGHT * along - a.pose("big_bin")[:2]) < reach).all()
                for tilt in tilts if lands else ():
                    down = quat_about((-along[1], along[0], 0), tilt)
                    poses += [
                        compose(pose(spot, quat_multiply(down, upright_goal(spot, yaw)[3:])), out)
                        for yaw in ROUND
                    ]
        return np.stack(poses)

    def _ends(self, a: Actor) -> list[np.ndarray]:
        return [self._over(a)[::5], self._tipped(a, slice(1), (2.2,))[::2]]

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        low, high = o.bodies["big_bin"].instance.shape().aabb()
        floor = o.bodies["big_bin"].instance.frames()["inside"][2]
        places = [o.pose(f"ball_{i + 1}")[:3] for i in range(len(BALLS))]
        balls = transform(inverse(o.pose("big_bin")), np.array(places))
        return {
            "balls_in_big_bin": bool(((balls > low) & (balls < high)).all()),
            "balls_at_bottom": bool((balls[:, 2] < floor + limit["depth"]).all()),
            "lifted": o.rise("bin") > limit["rise"],
            "held": o.holds("left", "bin"),
        }

import numpy as np

from pipeline.expert.skills import grasp, lift, rock, shake
from pipeline.poses import pose, quat_about, quat_multiply, quat_rotate
from pipeline.tasks.contract import (
    TABLE_TOP,
    Actor,
    Bodies,
    Draw,
    Limit,
    Outcome,
    Skills,
    Task,
    Workspace,
    by_name,
    register,
    sign_of,
    within,
)
from pipeline.world.objects.families.goods.bottles import BODY


@register
class ShakeBottle(Task):
    """Catch a moving bottle, lift it, swing it from side to side three times and hold it upright
    again."""

    step_limit = 700
    target = "bottle"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(
        rise=Limit(0.05, 0.015),
        tilt=Limit(0.35, unit="rad"),
        swing=Limit(0.4, unit="rad"),
        times=Limit(4, unit=""),
    )
    own_conditions = ("held", "upright", "shaken")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("bottle", x=(-0.25, 0.25), y=(-0.20, -0.05), yaw=(-0.79, 0.79))

    def meet(self, a: Actor) -> Skills:
        yield grasp(a.arms["arm"], "bottle", kinds=BODY, pitch=0.3)

    def finish(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        yield lift(arm, 0.12)
        yield shake(arm, times=6)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit = self.under(o.rules)
        return {
            "held": o.holds(arms["arm"], "bottle"),
            "lifted": o.rise("bottle") > limit["rise"],
            "upright": o.upright("bottle", limit["tilt"]),
            "shaken": o.swings("bottle", limit["swing"]) >= limit["times"],
        }


SPOTS = (
    *((0.08, -0.03, 0.20), (0.15, -0.08, 0.20), (0.10, -0.10, 0.14), (0.15, 0.05, 0.26)),
    *(
        (0.10, 0.00, 0.30),
        (0.20, 0.00, 0.30),
        (0.10, -0.10, 0.32),
        (0.00, 0.20, 0.30),
        (0.05, 0.10, 0.38),
    ),
)
"""Where the middle of the bottle is rocked (m): outwards, y, and height above the table."""


@register
class ShakeBottleHorizontally(ShakeBottle):
    """Catch a moving bottle, lift it, tip it until it lies level, and rock it about the level six
    times."""

    limits = by_name(**{**ShakeBottle.limits, "swing": Limit(0.3, unit="rad")})
    own_conditions = ("held", "level", "shaken")

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place("bottle", x=(-0.20, 0.20), y=(-0.15, -0.05), yaw=(-0.79, 0.79))

    def meet(self, a: Actor) -> Skills:
        goals = [list(self._tipped(a, lean)[0]) for lean in (0.0, 0.6, -0.6)]
        yield grasp(a.arms["arm"], "bottle", kinds=BODY, goals=goals, pitch=0.0)

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.12)
        yield rock(
            a.arms["arm"], *self._tipped(a), times=6, angles=(0.85, 0.7, 0.6, 0.5, 0.42, 0.38)
        )

    def _tipped(self, a: Actor, lean: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Poses (N,7) of the bottle in the air, its cap `lean` rad below the level, and level axes
        (N,3) across it."""
        middle, out = a.frames("bottle")["middle"][2], sign_of(a.arms["arm"])
        poses, axes = [], []
        for x, y, z in SPOTS:
            centre = np.array([out * x, y, TABLE_TOP + z])
            for heading in np.arange(0, 2 * np.pi, np.pi / 6).tolist():
                down = quat_about((0, 1, 0), np.pi / 2 + lean)
                tip = quat_multiply(quat_about((0, 0, 1), heading), down)
                for roll in range(8):
                    q = quat_multiply(tip, quat_about((0, 0, 1), roll * np.pi / 4))
                    poses.append(pose(centre - middle * quat_rotate(q, [0, 0, 1.0]), q))
                    axes.append([-np.sin(heading), np.cos(heading), 0.0])
        return np.array(poses), np.array(axes)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        limit, up = self.under(o.rules), quat_rotate(o.pose("bottle")[3:], [0, 0, 1.0])
        return {
            "held": o.holds(arms["arm"], "bottle"),
            "lifted": o.rise("bottle") > limit["rise"],
            "level": within(up[2], np.sin(limit["tilt"])),
            "shaken": o.rocks("bottle", limit["swing"]) >= limit["times"],
        }

from collections.abc import Sequence

from pipeline.expert.scripts import let_go, place_or_regrasp
from pipeline.expert.skills import ROUND, grasp, resting_poses, shift
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
    Skills,
    Workspace,
    by_name,
    register,
)
from pipeline.tasks.library.beyond.take.pick_from_belt import PickFromBelt


class StandOn(PickFromBelt):
    """Grasp the target by one of `kinds` of grasps, draw it `away` (3,) m, and stand it on body
    `support`."""

    kinds: Sequence[str] | None = None
    away: tuple[float, float, float] = (0.0, 0.0, 0.10)
    support = "pad"
    limits = by_name(plane=Limit(0.035), height=Limit(0.015), tilt=Limit(0.26, unit="rad"))

    def pad(
        self, draw: Draw, side: int, y: float = 0.0, half: float = 0.05, **apart: float
    ) -> Placement:
        """A pad on a side of the table, up to `y`, at distances (m) from bodies by name."""
        size = {"half": (half, half), "thickness": 0.004}
        return draw.place(
            "pad", x=(side * 0.24, side * 0.30), y=(-0.20, y), distances=apart, **size
        )

    def _onto(self, a: Actor) -> Pose:
        return a.frame(self.support, "centre")

    def meet(self, a: Actor) -> Skills:
        goals = resting_poses(a.frames(self.target)["base"], self._onto(a))
        yield grasp(a.arms["arm"], self.target, kinds=self.kinds, goals=[goals])

    def finish(self, a: Actor) -> Skills:
        arm = a.arms["arm"]
        yield shift(arm, self.away)
        yield place_or_regrasp(arm, "base", self._onto(a), yaws=ROUND)
        yield from let_go(arm)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        seated = o.seated(self.target, o.frame(self.support, "centre"), self.under(o.rules))
        return seated | o.set_down(self.target, self.support)


@register
class StandHandedObject(StandOn):
    """Grasp a can or a pill bottle that a flat hand brings, and stand it on a pad."""

    target = manipulated = "object"
    motion = "handed"
    workspace = Workspace(-0.40, 0.40, -0.25, 0.30)

    def layout(self, draw: Draw) -> Bodies:
        side, z = draw.side(), TABLE_TOP + draw.uniform(0.08, 0.14)
        yield draw.place(
            "object",
            "can",
            "pill_bottle",
            x=(side * 0.05, side * 0.18),
            y=(-0.15, 0.0),
            yaw=ANY_YAW,
            z=z,
            borne=True,
        )
        yield self.pad(draw, side, object=0.14)


@register
class StandHangingMug(StandOn):
    """Grasp a mug that hangs over the table on a cord, draw it away from the cord, and stand it on
    a coaster."""

    target = manipulated = "mug"
    support, motion = "coaster", "pendulum"
    kinds, away = ("side",), (0.0, -0.10, 0.0)

    def layout(self, draw: Draw) -> Bodies:
        side, z = draw.side(), TABLE_TOP + draw.uniform(0.06, 0.12)
        yield draw.place(
            "mug", x=(side * 0.05, side * 0.15), y=(-0.15, -0.05), yaw=ANY_YAW, z=z, borne=True
        )
        yield draw.place(
            "coaster", x=(side * 0.24, side * 0.30), y=(-0.20, 0.0), distances={"mug": 0.14}
        )


@register
class StandRampCan(StandOn):
    """Grasp a can or a pill bottle that slides down a ramp onto the table, and stand it on a pad
    beside."""

    target = manipulated = "can"
    motion = "ramp"

    def layout(self, draw: Draw) -> Bodies:
        side = draw.side()
        yield draw.place(
            "can", "can", "pill_bottle", x=(side * 0.05, side * 0.15), y=(-0.18, -0.02)
        )
        yield self.pad(draw, side, y=0.05, can=0.15)


@register
class StandTossedCube(StandOn):
    """Close the gripper on a puzzle cube that a plate tosses up, at the top of its flight, and set
    it down on a pad."""

    target = manipulated = "cube"
    motion = "toss"

    def layout(self, draw: Draw) -> Bodies:
        side, z = draw.side(), TABLE_TOP + draw.uniform(0.12, 0.20)
        yield draw.place(
            "cube",
            "rubiks_cube",
            x=(side * 0.05, side * 0.18),
            y=(-0.18, -0.05),
            yaw=(-0.7, 0.7),
            z=z,
        )
        yield self.pad(draw, side, half=0.055, cube=0.14)

from typing import cast

from pipeline.expert.skills import grasp, lift, shift
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
    register,
)
from pipeline.world.objects.families.toys.toy_car import PlayBall


@register
class PickFromBelt(Task):
    """Grasp a can or a bottle that rides on a belt and lift it off."""

    target = "product"
    motion = "conveyor"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.15)
    limits = by_name(rise=Limit(0.05))
    own_conditions = ()

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place(
            "product",
            "can",
            "sauce_can",
            "pill_bottle",
            x=(-0.22, 0.22),
            y=(-0.20, 0.0),
            yaw=ANY_YAW,
            away_from_centre=0.03,
        )

    def meet(self, a: Actor) -> Skills:
        yield grasp(a.arms["arm"], self.target)

    def finish(self, a: Actor) -> Skills:
        yield lift(a.arms["arm"], 0.12)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "held": o.holds(arms["arm"], self.target),
            "lifted": o.rise(self.target) > self.under(o.rules)["rise"],
            "off_table": not o.touching(self.target, "table"),
        }


@register
class TakeFromRamp(PickFromBelt):
    """Grasp a can or a bottle that slides down a ramp onto the table, and lift it."""

    motion = "ramp"


@register
class StopPushedCan(PickFromBelt):
    """Grasp a can or a bottle that a paddle has pushed and that slides, slowed by friction, off one
    cushion or two at level 3."""

    motion = "pushed"


@register
class StopRollingBall(PickFromBelt):
    """Close the gripper on a rolling ball and lift it."""

    target = manipulated = "ball"
    motion = "rolling"

    def layout(self, draw: Draw) -> Bodies:
        yield draw.place(
            "ball", "play_ball", x=(-0.25, 0.25), y=(-0.20, 0.0), yaw=ANY_YAW, away_from_centre=0.03
        )


@register
class TakeHandedObject(PickFromBelt):
    """Grasp a can or a bottle that a flat hand brings, and lift it off the hand."""

    target = manipulated = "object"
    motion = "handed"
    workspace = Workspace(-0.40, 0.40, -0.25, 0.30)

    def layout(self, draw: Draw) -> Bodies:
        z = TABLE_TOP + draw.uniform(0.08, 0.14)
        yield draw.place(
            "object",
            "can",
            "pill_bottle",
            x=(-0.25, 0.25),
            y=(-0.18, 0.0),
            yaw=ANY_YAW,
            away_from_centre=0.05,
            z=z,
            borne=True,
        )


@register
class CatchTossedBall(PickFromBelt):
    """Close the gripper on a ball that a plate tosses up, at the top of its flight, and lift it."""

    target = manipulated = "ball"
    motion = "toss"

    def layout(self, draw: Draw) -> Bodies:
        z = TABLE_TOP + draw.uniform(0.12, 0.20)
        yield draw.place(
            "ball",
            "play_ball",
            x=(-0.25, 0.25),
            y=(-0.20, -0.05),
            yaw=ANY_YAW,
            away_from_centre=0.05,
            z=z,
        )


@register
class StopOneOfTwoBalls(PickFromBelt):
    """Close the gripper on the ball of the colour asked for, while another one rolls across the
    table too, and lift it."""

    target = manipulated = "ball"
    motion, movers = "rolling", {"other": "rolling"}

    def layout(self, draw: Draw) -> Bodies:
        side, ball = draw.side(), cast(PlayBall, draw.one_of("play_ball"))
        other = cast(PlayBall, draw.one_of("play_ball"))
        while other.colour == ball.colour:
            other = cast(PlayBall, draw.one_of("play_ball"))
        near = Region(x=(side * 0.05, side * 0.25), y=(-0.20, 0.0), yaw=ANY_YAW)
        yield Placement("ball", ball, near)
        yield Placement(
            "other",
            other,
            Region(x=(-0.25, 0.25), y=(-0.20, 0.10), yaw=ANY_YAW),
            distances={"ball": 0.14},
        )


@register
class TakeHangingMug(PickFromBelt):
    """Grasp a mug that hangs over the table on a cord, and draw it away from the cord."""

    target = manipulated = "mug"
    motion = "pendulum"
    limits = by_name(distance=Limit(0.06))

    def layout(self, draw: Draw) -> Bodies:
        z = TABLE_TOP + draw.uniform(0.06, 0.12)
        yield draw.place(
            "mug",
            x=(-0.25, 0.25),
            y=(-0.20, -0.05),
            yaw=ANY_YAW,
            away_from_centre=0.05,
            z=z,
            borne=True,
        )

    def meet(self, a: Actor) -> Skills:
        yield grasp(a.arms["arm"], "mug", kinds=("side",))

    def finish(self, a: Actor) -> Skills:
        yield shift(a.arms["arm"], (0.0, -0.10, 0.0))

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "held": o.holds(arms["arm"], "mug"),
            "taken_away": o.travel("mug") > self.under(o.rules)["distance"],
            "off_table": not o.touching("mug", "table"),
        }

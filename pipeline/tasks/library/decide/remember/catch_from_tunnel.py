from pipeline.expert.skills import pause
from pipeline.tasks.contract import (
    ANY_YAW,
    Actor,
    Bodies,
    Draw,
    Outcome,
    Skills,
    Workspace,
    by_name,
    register,
)
from pipeline.tasks.library.beyond.take.pick_from_belt import PickFromBelt

WATCHED = 1.5  # s for which the arm stays at home: the product goes into the tunnel


@register
class CatchFromTunnel(PickFromBelt):
    """Grasp a can or a bottle that comes out of a tunnel, which hides it before, and lift it.

    Success: as `pick_from_belt`."""

    motion = "tunnel"

    def meet(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], WATCHED)
        yield from super().meet(a)


@register
class BlockBall(CatchFromTunnel):
    """Stop a ball before it crosses a goal line; on its way it may rebound from a wall.

    Success: a finger touched the ball, it is at rest, and its middle was never beyond the line."""

    target = manipulated = "ball"
    motion = "rebound"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.25)
    limits = by_name()

    def layout(self, draw: Draw) -> Bodies:
        x, y = (-0.18, 0.18), (-0.16, 0.02)
        yield draw.place("ball", "play_ball", x=x, y=y, yaw=ANY_YAW, away_from_centre=0.03)

    def finish(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], 0.5)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "touched": any(o.touched(side, "ball") for side in o.log.sides),
            "at_rest": o.at_rest("ball", point="middle"),
            "before_line": not o.crossed("ball", "middle", "goal_line"),
        }

from pipeline.expert.actor import Actor, Skills
from pipeline.expert.skills import pause
from pipeline.motion.workspace import Workspace
from pipeline.tasks.contract import Bodies, Draw, Placement, Region, by_name, register
from pipeline.tasks.outcome import Outcome

from .catch_from_tunnel import CatchFromTunnel


@register
class BlockBall(CatchFromTunnel):
    """Stop a ball before it crosses a goal line; on its way it may rebound from a wall.

    Success: a finger touched the ball, it is at rest, and its middle was never beyond the line."""

    target = manipulated = "ball"
    motion = "rebound"
    workspace = Workspace(-0.35, 0.35, -0.25, 0.25)
    limits = by_name()

    def layout(self, draw: Draw) -> Bodies:
        region = Region(x=(-0.18, 0.18), y=(-0.16, 0.02), yaw=(-3.14, 3.14), away_from_centre=0.03)
        yield Placement("ball", draw.one_of("play_ball"), region)

    def finish(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], 0.5)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "touched": any(o.touched(side, "ball") for side in o.log.sides),
            "at_rest": o.at_rest("ball", point="middle"),
            "before_line": not o.crossed("ball", "middle", "goal_line"),
        }

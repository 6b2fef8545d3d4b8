from pipeline.expert.actor import Actor, Skills
from pipeline.expert.skills import pause
from pipeline.tasks.contract import register
from pipeline.tasks.library.beyond.take.stop_rolling_ball import StopRollingBall
from pipeline.tasks.outcome import Outcome


@register
class BlockBall(StopRollingBall):
    """Stop a ball before it crosses a goal line; on its way it may rebound from a wall.

    Success: a finger touched the ball, it is at rest, and its middle was never beyond the line."""

    motion = "rebound"
    limits = {}

    def finish(self, a: Actor) -> Skills:
        yield pause(a.arms["arm"], 0.5)

    def success(self, o: Outcome, arms: dict[str, str]) -> dict[str, bool]:
        return {
            "touched": any(o.touched(side, "ball") for side in o.log.sides),
            "at_rest": o.at_rest("ball"),
            "before_line": not o.crossed("ball", "middle", "goal_line"),
        }

from pipeline.tasks.contract import register
from pipeline.tasks.library.beyond.take.stop_rolling_ball import StopRollingBall


@register
class CatchFromTunnel(StopRollingBall):
    """Close the gripper on a ball that comes out of a tunnel, which hides it before, and lift it.

    Success: as `pick_from_belt`."""

    motion = "tunnel"

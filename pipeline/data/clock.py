"""Clock rates of physics, recording and control."""

PHYSICS_HZ = 240  # steps a second; the recording rate divides it: every frame falls on a step
DEFAULT_FPS = 15  # recorded frames, and control periods, a second of simulated time


def at_rate(periods: int, fps: int) -> int:
    """How many periods of `fps` last as long as `periods` of DEFAULT_FPS, rounded up."""
    return -(-periods * fps // DEFAULT_FPS)

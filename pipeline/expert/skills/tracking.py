"""Follow a moving target."""

from collections.abc import Iterator

from pipeline.expert.actor import Actor, MotionStep, Skill, skill


@skill()
def track(side: str, act: Skill) -> Skill:
    """Carry out `act`, the skill that meets the target, at matched velocity: the hand moves with
    the target until they touch.

    In a still scene this is `act` itself. The planned expert moves its hand with the known motion
    (expert/tracking.py); the reactive one does so with whatever skill meets the target, from what
    it has seen.
    """

    def follow(a: Actor) -> Iterator[MotionStep]:
        yield from act(a)

    return follow

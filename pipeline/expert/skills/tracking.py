"""Follow a moving target."""

from pipeline.expert.actor import Actor, Skill, Steps, skill

from .pairing import stretched

PACE = 0.75  # share of the planned speed; half of the acceleration limit is left for following


@skill()
def track(a: Actor, side: str, act: Skill) -> Steps:
    """Carry out `act`, the skill that meets the target, at matched velocity.

    In a still scene this is `act` at PACE. The planned expert moves its hand with the known motion
    (expert/tracking.py), the reactive one with what it has seen."""
    for step in act(a):
        own = step[side]
        rows = round(len(own.q) / PACE)
        yield step | {side: stretched(own, rows, a.q(side), a.gripper(side))}

"""Sequences of skills that many tasks share."""

from collections.abc import Sequence

from pipeline.poses import Pose

from .actor import Actor, Skills
from .regrasping import place_or_regrasp, regrasp
from .skills import grasp, lift, open_, resting_poses, retreat


def set_down_on(
    a: Actor,
    side: str,
    name: str,
    onto: Pose,
    yaws: Sequence[float] = (0.0,),
    *,
    point: str = "base",
    up: float = 0.10,
    above: float = 0.10,
) -> Skills:
    """Grasp body `name`, lift it by `up` m, and set it down with its frame `point` on `onto` (7,),
    turned by one of `yaws`. If no single grasp can do it, it is set down in between."""
    goals = [resting_poses(a.frames(name)[point], onto, yaws)]
    yield from regrasp(a, side, name, goals)
    yield grasp(side, name, goals=goals)
    yield lift(side, up)
    yield place_or_regrasp(side, point, onto, yaws=yaws, above=above)


def let_go(side: str) -> Skills:
    """Open the gripper and draw the hand back."""
    yield open_(side)
    yield retreat(side, 0.08)

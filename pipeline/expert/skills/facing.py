"""Bring what both hands hold to each other in the air."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pipeline.expert.actor import Actor, Steps, skill
from pipeline.expert.budgets import MOVE
from pipeline.expert.candidates import hand_poses
from pipeline.planning.failure import PlanFailure
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import Floats, Pose

from .moving import reach

Towards = Callable[[Pose], Floats]  # poses (M,7) of the other body for one pose (7,) of the first


@skill(arms=("side", "other"))
def face(a: Actor, side: str, poses: ArrayLike, other: str, towards: Towards) -> Steps:
    """Carry the body that arm `side` holds to one of `poses` (N,7), and what arm `other` holds to
    one of the poses `towards` it. Raises PlanFailure("facing_blocked")."""
    name = a.held[side]
    yield {side: _shown(a, side, np.atleast_2d(np.asarray(poses, float)), other, towards)}
    yield {other: reach(a.arm_planner(other), hand_poses(a, other, towards(a.pose(name))))}


def _shown(a: Actor, side: str, poses: Floats, other: str, towards: Towards) -> ArmTrajectory:
    arm, there = a.arm_planner(side), a.arm_planner(other)
    q, ok = arm.solve(hand_poses(a, side, poses))
    free = arm.checker()
    found = [i for i in np.flatnonzero(ok) if free(q[i])]
    for i in found[:: max(1, len(found) // MOVE.tries)]:
        waiting = there.within(there.scene.expecting(side, q[i]))
        try:
            first = arm.free_trajectory(q[i], free)
            reach(waiting, hand_poses(a, other, towards(poses[i])))
        except PlanFailure:
            continue
        return first
    why = f"the {other} arm finds no way to what the {side} arm shows in {len(found)} poses"
    raise PlanFailure("facing_blocked", why)

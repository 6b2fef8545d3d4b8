"""What both hands do in the air."""

from collections.abc import Callable, Sequence
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from pipeline.planning.failure import PlanFailure
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import Floats, Pose

from ..actor import Actor, Steps, skill
from ..budgets import HAND_OVER, MOVE
from ..candidates import Goals, GraspOptions, backed_off, hand_poses
from ..grasping import can_take_over
from .hand import take
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


@skill(arms=("giver", "receiver"), part="kinds")
def hand_over(
    a: Actor,
    giver: str,
    receiver: str,
    places: ArrayLike,
    *,
    kinds: Sequence[str] | None = None,
    goals: Goals = (),
    leading: int = 0,
) -> Steps:
    """Carry the body that `giver` holds to one of the poses `places` (N,7), where `receiver` takes
    it too; the giver holds on. `kinds`, `goals` and `leading` are of the receiver's grasp."""
    options = GraspOptions(kinds, goals, pitch=HAND_OVER.pitch, leading=leading)
    name, poses = a.held[giver], np.atleast_2d(np.asarray(places, float))
    there = _meeting_point(a, giver, receiver, poses, options)
    yield {giver: there}
    with a.noting("grasp", (receiver,), name, "/".join(kinds or ())):
        yield from take(a, receiver, name, options)


def _meeting_point(
    a: Actor, giver: str, receiver: str, places: np.ndarray, options: GraspOptions
) -> ArmTrajectory:
    """The giver's free motion to where the receiver can take over. Raises PlanFailure:
    pose_unreachable, handover_blocked."""
    arm, hands = a.arm_planner(giver), hand_poses(a, giver, places)
    q, ok = arm.solve(hands)
    if not ok.any():
        why = f"no place of {len(places)} to hand over is in reach of the {giver} arm"
        raise PlanFailure("pose_unreachable", why)
    free = arm.checker()
    found = [i for i in np.flatnonzero(ok) if free(q[i])]
    some = found[:: max(1, len(found) // HAND_OVER.judged)]
    some.sort(key=lambda i: arm.line(q[i], backed_off(hands[i], HAND_OVER.draw_back)) is None)
    suited = (i for i in some if can_take_over(a, receiver, giver, q[i], options))
    for i in islice(suited, HAND_OVER.tries):
        try:
            return arm.free_trajectory(q[i], free)
        except PlanFailure:
            continue
    why = f"the {receiver} arm cannot take it over at any of {len(found)} places"
    raise PlanFailure("handover_blocked", why)

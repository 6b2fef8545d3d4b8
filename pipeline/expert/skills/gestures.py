"""Pour out what a held body contains, and turn the hand."""

from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import ArmPlanner
from pipeline.poses import (
    Floats,
    Pose,
    compose,
    inverse,
    quat_about,
    quat_multiply,
    quat_rotate,
    transform,
)

from ..actor import Actor, Steps, skill
from ..budgets import POUR, SPEEDS
from .hand import hand_boxes


@skill()
def pour(
    a: Actor,
    side: str,
    upright: ArrayLike,
    tipped: ArrayLike,
    *,
    sway: float = POUR.sway,
    speed: float = 1.0,
) -> Steps:
    """Bring the held body to one of the poses `upright` (N,7), then tip it to one of `tipped`
    (M,7). Its origin stays within `sway` m of where tipping begins or ends; what runs out should
    pass the hand. `speed` multiplies the joint speed limits."""
    arm, hold = a.arm_planner(side), inverse(a.in_hand(side))
    free = arm.checker()

    def reached(bodies: ArrayLike) -> tuple[Floats, Floats]:
        bodies = np.atleast_2d(np.asarray(bodies, float))
        q, ok = arm.solve(compose(bodies, hold[None]))
        found = [i for i in np.flatnonzero(ok) if free(q[i])]
        return bodies[found], q[found]

    (_, over), (ends, down) = reached(upright), reached(tipped)
    if not len(over) or not len(down):
        raise PlanFailure("pour_unreachable", f"the {side} arm cannot hold it upright and tipped")
    cost = np.linalg.norm(over[:, None] - down[None], axis=-1) + _pour_costs(a, side, hold, ends)
    paths = (
        (k // len(down), _tipping(over, down, k))
        for k in np.argsort(cost, axis=None, kind="stable")[: POUR.pairs]
    )
    quiet = ((i, path) for i, path in paths if _swayed(arm, hold, path) <= sway)
    shut = set[int]()  # upright postures to which no free motion leads
    for i, path in islice(quiet, POUR.tries):
        if i in shut or not free(path):
            continue
        try:
            trajectory = arm.free_trajectory(path[0], free)
        except PlanFailure:
            shut.add(i)
            continue
        yield {side: trajectory}
        yield {side: arm.timed(path[[0, -1]], speed_scale=speed)}
        return
    raise PlanFailure("pour_blocked", f"the {side} arm finds no path to tip what it holds")


def _tipping(over: Floats, down: Floats, pair: int) -> Floats:
    start, end = over[pair // len(down)], down[pair % len(down)]
    return start + np.linspace(0, 1, POUR.rows)[:, None] * (end - start)


def _swayed(arm: ArmPlanner, hold: Pose, path: Floats) -> float:
    """Largest distance (m) of the held body along rows (K,n) from the nearer end."""
    at = np.stack([compose(arm.fk(row), inverse(hold))[:3] for row in path])
    ends = [np.linalg.norm(at - end, axis=1) for end in (at[0], at[-1])]
    return float(np.minimum(*ends).max())


def _pour_costs(a: Actor, side: str, hold: Pose, bodies: Floats) -> Floats:
    """Costs (M,) in rad of pouring at poses `bodies` (M,7), tcp `hold` (7,) in the body: of a
    stream near the hand, weight off the jaws' axis, and an opening not straight down."""
    box = a.bodies[a.held[side]].instance.shape().aabb()
    down = quat_rotate(bodies[:, 3:] * [1, -1, -1, -1], [0, 0, -1.0])
    low = down * [1, 1, 0] / np.linalg.norm(down[:, :2], axis=1, keepdims=True)
    s = np.linspace(*POUR.stream, POUR.stream_points)[:, None]
    fallen = POUR.fall * np.maximum(s, 0) ** 2 * down[:, None]
    stream = (box[1, 0] - POUR.rim) * low[:, None] + (box[1, 2] + s) * [0, 0, 1] + fallen
    points = transform(inverse(hold), stream.reshape(-1, 3)).reshape(len(bodies), -1, 1, 3)
    pieces = hand_boxes(a.planner.embodiment.arms[side])
    outside = np.maximum(pieces[:, 0] - points, points - pieces[:, 1])
    apart = np.linalg.norm(np.maximum(outside, 0), axis=-1).min((1, 2))
    lever = np.abs(low @ np.cross(box.mean(0) - hold[:3], quat_rotate(hold[3:], [0, 1.0, 0])))
    missing = np.maximum(0, POUR.room - apart)
    return (
        POUR.room_weight * missing
        + POUR.lever_weight * lever
        + POUR.level_weight * (1 - down[:, 2])
    )


@skill()
def turn(
    a: Actor,
    side: str,
    axis: ArrayLike,
    angle: float,
    *,
    rise: float = 0.0,
    speed: float = SPEEDS.swing_scale,
) -> Steps:
    """Turn the hand about an axis of its tcp frame by `angle` rad while it rises by `rise` m.
    `speed` multiplies the joint speed limits."""
    arm, start = a.arm_planner(side), a.tcp(side)
    turned = quat_multiply(start[3:], quat_about(axis, angle))
    goal = np.concatenate([start[:3] + np.array([0, 0, rise]), turned])
    path = arm.line(arm.q, goal)
    if path is None or not arm.apart()(path):
        raise PlanFailure("turn_unreachable", f"the {side} wrist cannot turn that far")
    yield {side: arm.timed(path, speed_scale=speed)}

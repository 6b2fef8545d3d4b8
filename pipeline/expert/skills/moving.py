"""Moves of the hand, free or straight, with or without a body in it."""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import ArmPlanner
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import Floats, Pose, lifted

from ..actor import Actor, Steps, skill
from ..budgets import MOVE, SPEEDS
from ..candidates import backed_off, hand_poses

_STEP_OFF_DIRECTIONS = ((0, 0, 1), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0))


@skill()
def move(a: Actor, side: str, poses: ArrayLike, *, speed: float = 1.0) -> Steps:
    """Bring the tcp to the first of `poses` (N,7) or (7,) that can be reached without touching
    anything. `speed` multiplies the joint speed limits."""
    goals = np.atleast_2d(np.asarray(poses, float))
    yield {side: reach(a.arm_planner(side), goals, speed_scale=speed)}


@skill()
def carry(a: Actor, side: str, bodies: ArrayLike, *, speed: float = 1.0) -> Steps:
    """Move as `move` does, for the held body."""
    hands = hand_poses(a, side, np.atleast_2d(np.asarray(bodies, float)))
    yield {side: reach(a.arm_planner(side), hands, speed_scale=speed)}


def reach(arm: ArmPlanner, poses: Floats, *, speed_scale: float = 1.0) -> ArmTrajectory:
    """A motion to the first feasible pose. Raises PlanFailure: pose_unreachable, path_blocked."""
    q, ok = arm.solve(poses)
    if not ok.any():
        why = f"none of {len(poses)} poses is in reach of the {arm.side} arm"
        raise PlanFailure("pose_unreachable", why)
    free = arm.checker()
    found = [i for i in np.flatnonzero(ok) if free(q[i])]
    for i in found[: MOVE.tries]:
        try:
            return arm.free_trajectory(q[i], free, speed_scale=speed_scale)
        except PlanFailure:
            continue
    raise PlanFailure("path_blocked", f"the {arm.side} arm finds no path to {len(poses)} poses")


@skill()
def lift(
    a: Actor,
    side: str,
    height: float,
    *,
    least: float = MOVE.least_lift,
    speed: float = SPEEDS.lift,
) -> Steps:
    """Move the tcp straight up, by less (the share `least` at least) if the arm cannot go
    higher."""
    line, share = next(_lifts(a.arm_planner(side), a.tcp(side), height, least))
    yield {side: a.arm_planner(side).timed(line, minimum=abs(height) * share / speed)}


@skill()
def lift_clear(a: Actor, side: str, height: float, *, speed: float = SPEEDS.lift) -> Steps:
    """Lift as `lift` does, up to where arm and held body touch nothing."""
    arm = a.arm_planner(side)
    free, start = arm.checker(), a.tcp(side)
    clear = ((line, share) for line, share in _lifts(arm, start, height) if free(line[-1]))
    line, share = next(clear, None) or next(_lifts(arm, start, height))
    yield {side: arm.timed(line, minimum=abs(height) * share / speed)}


def _lifts(
    arm: ArmPlanner, start: Pose, height: float, least: float = 0.0
) -> Iterator[tuple[Floats, float]]:
    """Ways up: joints (K,n) and share of the height, highest first. Raises PlanFailure."""
    found, apart = False, arm.apart()
    for share in (s for s in MOVE.lift_shares if s >= least):
        line = arm.line(arm.q, lifted(start, height * share))
        if line is not None and apart(line):
            found = True
            yield line, share
    if not found:
        raise PlanFailure("line_unreachable", f"the {arm.side} arm cannot lift by {height} m")


@skill()
def shift(a: Actor, side: str, by: ArrayLike, *, speed: float = SPEEDS.shift) -> Steps:
    """Move the hand straight by a vector (3,) of the world, by 80 % at least."""
    arm, start = a.arm_planner(side), a.tcp(side)
    apart = arm.apart()
    offset = np.concatenate([np.asarray(by, float), np.zeros(4)])
    for share in MOVE.shift_shares:
        path = arm.line(arm.q, start + share * offset)
        if path is not None and apart(path):
            yield {side: arm.timed(path, minimum=share * float(np.linalg.norm(offset)) / speed)}
            return
    why = f"the {side} arm cannot move its hand by {np.round(offset[:3], 3)} m"
    raise PlanFailure("line_unreachable", why)


@skill()
def retreat(a: Actor, side: str, distance: float, *, speed: float = SPEEDS.retreat) -> Steps:
    """Draw the hand straight back along its approach axis, by less (20 % at least), or straight
    up."""
    arm, start = a.arm_planner(side), a.tcp(side)
    apart = arm.apart()
    back = [backed_off(start, distance * share) for share in MOVE.retreat_shares]
    for goal in (*back, *(lifted(start, share * distance) for share in MOVE.rise_shares)):
        path = arm.line(arm.q, goal)
        if path is not None and apart(path):
            metres = float(np.linalg.norm(goal[:3] - start[:3]))
            yield {side: arm.timed(path, minimum=metres / speed)}
            return
    raise PlanFailure("line_unreachable", f"the {side} arm cannot draw back by {distance} m")


@skill()
def home(a: Actor, side: str) -> Steps:
    """Return the arm to its home joints; if it finds no path, it first steps off, or rises, else
    stays."""
    arm = a.arm_planner(side)
    free = arm.checker()
    if free(arm.q):
        with suppress(PlanFailure):
            yield {side: arm.free_trajectory(arm.chain.home, free)}
            return
    tcp = a.tcp(side)
    rises = (lifted(tcp, height) for height in MOVE.rises)
    lines = (arm.line(arm.q, goal) for goal in (*_steps_off(tcp), *rises))
    apart = arm.apart()
    for off in (line for line in lines if line is not None and free(line[-1]) and apart(line)):
        there = arm.within(arm.scene.commanding(side, off[-1]))
        with suppress(PlanFailure):
            back = there.free_trajectory(arm.chain.home, free)
            yield {side: arm.timed(off)}
            yield {side: back}
            return


def _steps_off(tcp: Pose) -> list[Pose]:
    poses = []
    for distance in MOVE.steps_off:
        steps = [np.array([*direction, 0, 0, 0, 0]) for direction in _STEP_OFF_DIRECTIONS]
        poses += [backed_off(tcp, distance), *(tcp + distance * step for step in steps)]
    return poses

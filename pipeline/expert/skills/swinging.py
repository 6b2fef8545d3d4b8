"""Shake or rock a held body."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from pipeline.planning.failure import PlanFailure
from pipeline.planning.path import IsFree
from pipeline.planning.planner import ArmPlanner
from pipeline.poses import Floats, Pose, lifted, quat_about, quat_multiply, quat_rotate

from ..actor import Actor, Steps, skill
from ..budgets import SPEEDS, SWING
from ..candidates import hand_poses


@dataclass(frozen=True, eq=False)
class _Swing:
    """A swing about tcp pose `middle` (7,) from joints q (n,) through `out`, `across` (K,n)."""

    q: Floats
    middle: Pose
    ends: list[Pose]
    out: Floats
    across: Floats


@skill()
def shake(a: Actor, side: str, times: int, *, rise: float = 0.03) -> Steps:
    """Swing the hand `times` times from side to side about a nearly level axis: the first with
    room, with the widest swing that fits; else from a place nearby."""
    arm = a.arm_planner(side)
    free, tries = arm.checker(), SWING.shake_tries
    places = ((a.tcp(side), a.q(side)), *_nearby(arm, a.tcp(side)))
    for (goal, q), angle in product(places, SWING.shake_angles):
        for axis in _shake_axes(goal, angle):
            ends = [_turned(lifted(goal, rise), axis, angle), _turned(goal, axis, -angle)]
            swing = _swing(arm, q, goal, ends)
            if swing is None or not (free(swing.out) and free(swing.across)):
                continue
            try:
                trajectory = arm.free_trajectory(q, free)
            except PlanFailure:
                tries -= 1
                if not tries:
                    raise
                continue
            yield {side: trajectory}
            yield from _swung(a, side, swing, times, SPEEDS.swing_scale)
            return
    raise PlanFailure("shake_unreachable", f"the {side} arm cannot swing its hand either way")


@skill()
def rock(
    a: Actor,
    side: str,
    bodies: ArrayLike,
    about: ArrayLike,
    times: int,
    *,
    angles: Sequence[float] = SWING.rock_angles,
    speed: float = SPEEDS.swing_scale,
) -> Steps:
    """Carry the held body to one of the poses `bodies` (N,7), rock it to either side about the
    world axes `about` (N,3), and come back. The first pose with room for the widest of `angles`
    (rad) is taken. `speed` multiplies the joint speed limits."""
    arm = a.arm_planner(side)
    hands = hand_poses(a, side, np.atleast_2d(np.asarray(bodies, float)))
    axes = np.atleast_2d(np.asarray(about, float))
    q, ok = arm.solve(hands)
    free: IsFree = arm.checker()
    tries = SWING.rock_tries
    for angle in angles:
        for i in np.flatnonzero(ok):
            ends = [_turned(hands[i], axes[i], by) for by in (angle, -angle)]
            swing = _swing(arm, q[i], hands[i], ends)
            if swing is None or not (free(q[i]) and free(swing.out) and free(swing.across)):
                continue
            tries -= 1
            if tries < 0:
                break
            try:
                trajectory = arm.free_trajectory(q[i], free)
            except PlanFailure:
                continue
            yield {side: trajectory}
            yield from _swung(a, side, swing, times, speed)
            return
    raise PlanFailure("rock_unreachable", f"the {side} arm finds no room to rock what it holds")


def _swing(arm: ArmPlanner, q: Floats, middle: Pose, ends: list[Pose]) -> _Swing | None:
    out = arm.line(q, ends[0])
    across = None if out is None else arm.line(out[-1], ends[1])
    return None if out is None or across is None else _Swing(q, middle, ends, out, across)


def _swung(a: Actor, side: str, swing: _Swing, times: int, speed_scale: float) -> Steps:
    yield {side: a.arm_planner(side).timed(swing.out, speed_scale=speed_scale)}
    for goal in (*(swing.ends[1 - k % 2] for k in range(times)), swing.middle):
        arm = a.arm_planner(side)
        path = arm.line(arm.q, goal)
        if path is None:
            raise PlanFailure("line_unreachable", f"the {side} arm cannot swing on from here")
        yield {side: arm.timed(path, speed_scale=speed_scale)}


def _shake_axes(hand: Pose, angle: float) -> Iterator[Floats]:
    """World axes (3,), level ones first, whose swing tilts the hand enough."""
    x, y = quat_rotate(hand[3:], [1.0, 0, 0])[:2]
    for slope, turns in product(SWING.slopes, SWING.quarter_turns):
        if 2 * np.arcsin(np.sin(angle / 2) * np.cos(slope)) >= SWING.least_angle:
            heading = np.arctan2(y, x) + turns * np.pi / 4
            level = np.cos(slope)
            yield np.array([np.cos(heading) * level, np.sin(heading) * level, np.sin(slope)])


def _turned(hand: Pose, axis: ArrayLike, angle: float) -> Pose:
    return np.concatenate([hand[:3], quat_multiply(quat_about(axis, angle), hand[3:])])


def _nearby(arm: ArmPlanner, start: Pose) -> list[tuple[Pose, Floats]]:
    """Hand poses near (7,), as upright as it is, with joints that reach them."""
    heights, offsets = SWING.near_heights, SWING.near_offsets
    ways = [*product(heights, offsets, offsets, SWING.near_turns)][1:]
    near = ((start + np.array([x, y, z, 0, 0, 0, 0]), yaw) for z, x, y, yaw in ways)
    poses = np.array([_turned(place, (0, 0, 1), yaw) for place, yaw in near])
    q, ok = arm.solve(poses)
    return [(poses[i], q[i]) for i in np.flatnonzero(ok)]

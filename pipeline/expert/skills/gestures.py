"""What is done with a held body: pour, turn, shake, rock."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.expert.actor import Actor, Beat, Skill
from pipeline.expert.failure import PlanFailure
from pipeline.expert.grasping import hand_poses, lifted
from pipeline.poses import Pose, compose, inverse, pose, quat_about, quat_multiply, quat_rotate


def pour(side: str, upright: ArrayLike, tipped: ArrayLike, *, sway: float = 0.16, speed: float = 1.0) -> Skill:
    """Bring the held body to one of the poses `upright` (N,7), then tip it, all joints at an even pace, to one of `tipped` (M,7).

    While it tips, its origin stays within `sway` m of where it begins or ends, and nothing is touched.
    """

    def act(a: Actor) -> Iterator[Beat]:
        hold, free = inverse(a.in_hand(side)), a.planner.checker(a, side)
        fingers = hold[:2] / np.linalg.norm(hold[:2])

        def over_fingers(body: Pose) -> float:
            """Cosine of the angle, about the body's axis, between its lowest side and the fingers."""
            low = quat_rotate(body[3:] * [1, -1, -1, -1], [0, 0, -1.0])[:2]
            return float(low @ fingers / np.linalg.norm(low))

        def reached(bodies: NDArray[np.float64]) -> NDArray[np.float64]:
            q, ok = a.planner.solve(a, side, compose(bodies, hold[None]))
            return np.stack([row for row in q[ok] if free(row)] or [np.empty((0,))])

        ends = np.atleast_2d(np.asarray(tipped, float))
        ends = ends[[over_fingers(body) < 0.3 for body in ends]]
        over, down = reached(np.atleast_2d(np.asarray(upright, float))), reached(ends)
        if not over.size or not down.size:
            raise PlanFailure("pour_unreachable", f"the {side} arm cannot hold it there, upright and tipped")
        distance = np.linalg.norm(over[:, None] - down[None], axis=-1)
        for k in np.argsort(distance, axis=None, kind="stable")[:80]:
            start, end = over[k // len(down)], down[k % len(down)]
            path = start + np.linspace(0, 1, 16)[:, None] * (end - start)
            at = np.stack([compose(a.planner.fk(side, row), inverse(hold))[:3] for row in path])
            off = np.minimum(np.linalg.norm(at - at[0], axis=1), np.linalg.norm(at - at[-1], axis=1))
            if off.max() > sway or not free(path):
                continue
            try:
                leg = a.planner.free_leg(a, side, start, free)
            except PlanFailure:
                continue
            yield {side: leg}
            yield {side: a.planner.timed(side, path[[0, -1]], a.gripper(side), speed=speed)}
            return
        raise PlanFailure("pour_blocked", f"the {side} arm finds no way to tip what it holds")

    return act


def turn(side: str, axis: ArrayLike, angle: float, *, rise: float = 0.0, speed: float = 2.0) -> Skill:
    """Turn the hand about an axis of its own tcp frame by `angle` rad while it rises by `rise` m; `speed` multiplies the pace."""

    def act(a: Actor) -> Iterator[Beat]:
        start = a.tcp(side)
        goal = np.concatenate([start[:3] + np.array([0, 0, rise]), quat_multiply(start[3:], quat_about(axis, angle))])
        path = a.planner.line(side, a.q(side), goal)
        if path is None:
            raise PlanFailure("turn_unreachable", f"the {side} wrist cannot turn that far")
        yield {side: a.planner.timed(side, path, a.gripper(side), speed=speed)}

    return act


def shake(side: str, times: int, *, axes: Sequence[ArrayLike] = ((1, 0, 0), (0, 1, 0), (0, 0, 1)), rise: float = 0.03) -> Skill:
    """Swing the hand `times` times from side to side.

    The first of `axes` (in the tcp frame) with room on both sides is taken, with the widest swing of 0.9 to 0.55 rad that fits.
    """

    def act(a: Actor) -> Iterator[Beat]:
        start = a.tcp(side)
        for angle in (0.9, 0.75, 0.65, 0.55):
            for axis in axes:
                ends = [
                    compose(lifted(start, up), pose((0, 0, 0), quat_about(axis, sign * angle))) for sign, up in ((1, rise), (-1, 0))
                ]
                out = a.planner.line(side, a.q(side), ends[0])
                across = None if out is None else a.planner.line(side, out[-1], ends[1])
                if out is None or across is None:
                    continue
                yield {side: a.planner.timed(side, out, a.gripper(side), speed=2.0)}
                for k in range(times):
                    yield {side: a.planner.line_leg(a, side, ends[1 - k % 2], 10.0, pace=2.0)}
                yield {side: a.planner.line_leg(a, side, start, 10.0, pace=2.0)}
                return
        raise PlanFailure("shake_unreachable", f"the {side} arm cannot swing its hand either way")

    return act


def rock(
    side: str, bodies: ArrayLike, about: ArrayLike, times: int, *, angles: Sequence[float] = (0.85, 0.7, 0.6), speed: float = 2.0
) -> Skill:
    """Carry the held body to one of the poses `bodies` (N,7), rock it `times` times to either side, and come back to that pose.

    It turns with the hand about the world axes `about` (N,3), one per pose. The first pose is taken that leaves room for the
    widest of `angles` (rad); narrower ones are tried where there is none.
    """

    def act(a: Actor) -> Iterator[Beat]:
        hands = hand_poses(a, side, np.atleast_2d(np.asarray(bodies, float)))
        axes = np.atleast_2d(np.asarray(about, float))
        q, ok = a.planner.solve(a, side, hands)
        free = a.planner.checker(a, side)
        tries = 12
        for angle in angles:
            for i in np.flatnonzero(ok):
                ends = [
                    np.concatenate([hands[i, :3], quat_multiply(quat_about(axes[i], s * angle), hands[i, 3:])]) for s in (1, -1)
                ]
                out = a.planner.line(side, q[i], ends[0])
                across = None if out is None else a.planner.line(side, out[-1], ends[1])
                if out is None or across is None or not (free(q[i]) and free(out) and free(across)):
                    continue
                tries -= 1
                if tries < 0:
                    break
                try:
                    leg = a.planner.free_leg(a, side, q[i], free)
                except PlanFailure:
                    continue
                yield {side: leg}
                yield {side: a.planner.timed(side, out, a.gripper(side), speed=speed)}
                for k in range(times):
                    yield {side: a.planner.line_leg(a, side, ends[1 - k % 2], 10.0, pace=speed)}
                yield {side: a.planner.line_leg(a, side, hands[i], 10.0, pace=speed)}
                return
        raise PlanFailure("rock_unreachable", f"the {side} arm finds no room to rock what it holds")

    return act

"""What is done with a held body: pour it, turn it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.expert.actor import Actor, Beat, Skill
from pipeline.expert.failure import PlanFailure
from pipeline.expert.reach import hand_boxes
from pipeline.poses import Pose, compose, inverse, quat_about, quat_multiply, quat_rotate, transform

SPILL_ROOM = 0.03
"""How far (m) the hand should keep from what is poured."""


def pour(side: str, upright: ArrayLike, tipped: ArrayLike, *, sway: float = 0.16, speed: float = 1.0) -> Skill:
    """Bring the held body to one of the poses `upright` (N,7), then tip it, all joints at an even pace, to one of `tipped` (M,7).

    While it tips, its origin stays within `sway` m of where it begins or ends, and nothing is touched. Ways are preferred on which
    what runs out over its lowest edge passes the hand.
    """

    def act(a: Actor) -> Iterator[Beat]:
        hold, free = inverse(a.in_hand(side)), a.planner.checker(a, side)

        def reached(bodies: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            """Body poses that can be had, with their joints."""
            bodies = np.atleast_2d(np.asarray(bodies, float))
            q, ok = a.planner.solve(a, side, compose(bodies, hold[None]))
            kept = [i for i in np.flatnonzero(ok) if free(q[i])]
            return bodies[kept], q[kept]

        (_, over), (ends, down) = reached(upright), reached(tipped)
        if not len(over) or not len(down):
            raise PlanFailure("pour_unreachable", f"the {side} arm cannot hold it there, upright and tipped")
        bad = np.array(
            [200.0 * max(0.0, SPILL_ROOM - _spill_room(a, side, hold, body)) + 100.0 * _lever(a, side, hold, body) for body in ends]
        )
        cost = np.linalg.norm(over[:, None] - down[None], axis=-1) + bad
        for k in np.argsort(cost, axis=None, kind="stable")[:80]:
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


def _lever(a: Actor, side: str, hold: Pose, body: Pose) -> float:
    """How far (m) off the axis of the jaws the weight of the held body at pose `body` pulls, which turns it in the grip."""
    middle = quat_rotate(body[3:], a.bodies[a.held[side]].instance.shape().aabb().mean(0) - hold[:3])
    jaws = quat_rotate(compose(body, hold)[3:], [0, 1.0, 0])
    return abs(float(middle[0] * jaws[1] - middle[1] * jaws[0]))


def _spill_room(a: Actor, side: str, hold: Pose, body: Pose) -> float:
    """How far (m) from the hand, at `hold` in the held body's frame, what runs out of the body at pose `body` passes."""
    _, high = a.bodies[a.held[side]].instance.shape().aabb()
    down = quat_rotate(body[3:] * [1, -1, -1, -1], [0, 0, -1.0])
    low = np.array([*(down[:2] / np.linalg.norm(down[:2])), 0.0])
    s = np.linspace(-0.02, 0.08, 6)[:, None]
    stream = (high[0] - 0.012) * low + (high[2] + s) * [0, 0, 1] + 9.0 * np.maximum(s, 0) ** 2 * down
    points = transform(inverse(hold), stream)[:, None]
    boxes = hand_boxes(a.planner.embodiment.arms[side])
    return float(np.linalg.norm(np.maximum(np.maximum(boxes[:, 0] - points, points - boxes[:, 1]), 0), axis=-1).min())


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

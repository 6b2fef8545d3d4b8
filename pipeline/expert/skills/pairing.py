"""Two arms at once."""

from collections.abc import Iterator

import numpy as np

from pipeline.data.names import SIDES
from pipeline.expert.actor import Actor, MotionStep, Skill
from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import NO_ARM, Apart
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import Floats

CHECKED_EVERY = 4  # physics steps between two checks of the arms (17 ms)


def together(*skills: Skill) -> Skill:
    """Skills of different arms, motion step by motion step at the same time. Arms whose
    trajectories would collide take turns for that step; if these collide too,
    PlanFailure("arms_collide") is raised."""

    def act(a: Actor) -> Iterator[MotionStep]:
        running = [skill(a) for skill in skills]
        while running:
            step: MotionStep = {}
            for one in list(running):
                planned = next(one, None)
                if planned is None:
                    running.remove(one)
                else:
                    step |= planned
                    a.expected |= {side: trajectory.q[-1] for side, trajectory in planned.items()}
            a.expected.clear()
            if step:
                yield from _in_turns(a, step)

    return act


def _in_turns(a: Actor, step: MotionStep) -> Iterator[MotionStep]:
    apart = a.planner.apart(a.planning_scene())
    longest = max(len(trajectory.q) for trajectory in step.values())
    at_once = {
        side: stretched(trajectory, longest, a.q(side), a.gripper(side))
        for side, trajectory in step.items()
    }
    if _arms_apart(a, apart, at_once):
        yield at_once
        return
    sides = list(step)
    for order in (sides, sides[::-1]):
        turns = (
            {side: step[side]} | {s: _end_of(step[s]) for s in order[:i]}
            for i, side in enumerate(order)
        )
        if all(_arms_apart(a, apart, turn) for turn in turns):
            for side in order:
                yield {side: step[side]}
            return
    raise PlanFailure("arms_collide", "the arms would touch each other")


def _end_of(t: ArmTrajectory) -> ArmTrajectory:
    return ArmTrajectory(t.q[-1:], t.qd[-1:], t.gripper[-1:])


def stretched(t: ArmTrajectory, rows: int, q0: Floats, value: float) -> ArmTrajectory:
    """The trajectory from joints q0 (n,) and gripper `value`, slower, in `rows` steps; jaw motions
    keep their pace."""
    n = len(t.q)
    if n == rows:
        return t
    if np.ptp(np.vstack([q0, t.q]), axis=0).max() < 1e-9:
        pad = rows - n
        q = np.pad(t.q, ((0, pad), (0, 0)), mode="edge")
        return ArmTrajectory(q, np.zeros_like(q), np.pad(t.gripper, (0, pad), mode="edge"))
    at = np.arange(1, rows + 1) * (n / rows)
    old = np.arange(n + 1)
    q = np.vstack([q0, t.q])
    qd = np.vstack([np.zeros_like(q0), t.qd])
    joints = [np.interp(at, old, column) for column in q.T]
    speeds = [np.interp(at, old, column) * (n / rows) for column in qd.T]
    jaws = np.interp(at, old, np.concatenate([[value], t.gripper]))
    return ArmTrajectory(np.stack(joints, 1), np.stack(speeds, 1), jaws)


def _arms_apart(a: Actor, apart: Apart, step: MotionStep) -> bool:
    q = {
        side: step[side].q if side in step else a.q(side)[None]
        for side in a.planner.embodiment.sides
    }
    last = max(map(len, q.values())) - 1
    rows = np.append(np.arange(0, last + 1, CHECKED_EVERY), last)
    left, right = (
        q[side][np.minimum(rows, len(q[side]) - 1)] if side in q else NO_ARM for side in SIDES
    )
    return apart(left, right)

"""Several skills as one."""

from collections.abc import Iterator

import numpy as np

from pipeline.data.names import SIDES
from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import NO_ARM, Apart
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import Floats

from ..actor import Actor, MotionStep, Skill, Steps, skill


def first_of(*skills: Skill) -> Skill:
    """The first of the skills that can be planned now; none replaces one that fails after its first
    motion step. Raises the last one's PlanFailure."""

    def act(a: Actor) -> Iterator[MotionStep]:
        for each in skills[:-1]:
            steps = each(a)
            try:
                first = next(steps)
            except (PlanFailure, StopIteration):
                continue
            yield first
            yield from steps
            return
        yield from skills[-1](a)

    return act


def in_turn(*skills: Skill) -> Skill:
    """The skills one after another as one, so that the meeting may be in any of them."""

    def act(a: Actor) -> Iterator[MotionStep]:
        for each in skills:
            yield from each(a)

    return act


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
    """The trajectory slowed to `rows` steps; jaw motions keep their pace."""
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

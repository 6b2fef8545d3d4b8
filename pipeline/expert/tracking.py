"""A planned hand moves with a known target, at matched velocity."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import SkillRun
from pipeline.data.names import SIDES
from pipeline.planning.budgets import LIMITS
from pipeline.planning.failure import PlanFailure
from pipeline.planning.kinematics import ik_many
from pipeline.planning.planner import NO_ARM, Planner
from pipeline.poses import Floats, Pose, inverse, transform

from .limiter import WINDOW, Limiter
from .reactive.controller import CLOSE, SAME_BRANCH

TRACK = "track"

KNOTS = 16  # physics steps between two poses that are solved; joints follow a cubic spline
AT_REST = 1e-3  # rad/s or m/s; an arm whose joints are all slower rests
STOPPING = 0.06  # s, time constant with which a hand comes to rest after the meeting
STOPPED = 1e-6  # rad/s or m/s; commands that are slower may end
AHEAD = WINDOW // 2  # physics steps of the limiter's lag


def carried_along(
    planner: Planner,
    plan: tuple[Floats, Floats],
    run: SkillRun,
    target: Callable[[Floats], Pose],
    met: int,
) -> tuple[Floats, Floats]:
    """Commands (M,A) and velocities of a plan (N,A) whose arms move with the target; M >= N. From
    the last approach on each hand is displaced, not turned; after `met` it comes to rest. Raises
    PlanFailure: track_unreachable, arms_collide."""
    commands, velocities = plan
    goals, column, arms = commands.copy(), 0, dict[str, slice]()
    for side in planner.embodiment.sides:
        joints = arms[side] = slice(column, column + len(planner.home(side)))
        if side in run.arms:
            near = _approach_begins(velocities[:, joints], run.start, met)
            goals[run.start :, joints] += _shifts(
                planner, side, commands[:, joints], (run.start, near, met), target
            )
        column = joints.stop + 1
    moved, speeds = _limited(planner, goals, run.start)
    more = ((0, len(moved) - len(commands)), (0, 0))
    found, found_speeds = np.pad(commands, more, mode="edge"), np.pad(velocities, more)
    for side in run.arms:
        joints = arms[side]
        off = planner.fk(side, moved[met, joints])[:3] - planner.fk(side, goals[met, joints])[:3]
        if (miss := float(np.linalg.norm(off))) > CLOSE:
            late = f"{1e3 * miss:.0f} mm late: the target turns too sharply"
            raise PlanFailure("track_unreachable", f"the {side} hand is {late}")
        found[:, joints], found_speeds[:, joints] = moved[:, joints], speeds[:, joints]
    rows = found[run.start :: LIMITS.checked_every]
    left, right = (rows[:, arms[side]] if side in arms else NO_ARM for side in SIDES)
    if planner.world.between_arms({}).first_blocked(left, right) is not None:
        raise PlanFailure("arms_collide", "the hand that tracks would touch the other arm")
    return found, found_speeds


def _shifts(
    planner: Planner,
    side: str,
    q: Floats,
    rows: tuple[int, int, int],
    target: Callable[[Floats], Pose],
) -> Floats:
    """Offsets (M,n) of joints `q` (N,n) that carry the hand along, growing up to row `near`."""
    start, near, met = rows
    knots = np.unique([*range(start, len(q), KNOTS), met, len(q) - 1])
    times, meeting = (knots + 1) / PHYSICS_HZ, (met + 1) / PHYSICS_HZ
    late = np.maximum(times - meeting, 0.0)
    where = target(np.minimum(times, meeting) + STOPPING * (1 - np.exp(-late / STOPPING)))
    touch = planner.fk(side, q[met])[:3]
    at_touch = transform(inverse(target(np.array([meeting]))[0]), touch)
    share = np.clip((knots - start) / max(1, near - start), 0.0, 1.0)
    share = share * share * (3 - 2 * share)
    shift, shifts = np.zeros(q.shape[1]), list[Floats]()
    for row, pose, part in zip(knots, where, share, strict=True):
        goal = planner.fk(side, q[row])
        goal[:3] += part * (transform(pose, at_touch) - touch)
        solved, ok = ik_many(planner.chains[side], goal[None], (q[row] + shift)[None], SAME_BRANCH)
        if not ok[0]:
            why = f"the {side} arm cannot move along with the target"
            raise PlanFailure("track_unreachable", why)
        shift = solved[0] - q[row]
        shifts.append(shift)
    return CubicSpline(knots, np.array(shifts), bc_type="clamped")(np.arange(start, len(q)))


def _limited(planner: Planner, goals: Floats, start: int) -> tuple[Floats, Floats]:
    """Commands (M,A) that follow `goals` (N,A), and their velocities, at rest at both ends."""
    ahead = np.concatenate([goals, np.repeat(goals[-1:], AHEAD, axis=0)])[AHEAD:]
    speeds = np.diff(ahead, axis=0, prepend=ahead[:1]) * PHYSICS_HZ
    limiter = Limiter(goals[max(0, start - 1)], *planner.command_limits())
    followed = [limiter.follow(ahead[row], speeds[row]) for row in range(start, len(goals))]
    while np.abs(followed[-1][1]).max() > STOPPED:
        followed.append(limiter.follow(ahead[-1], np.zeros_like(ahead[-1])))
    rows, rates = (np.array(column) for column in zip(*followed, strict=True))
    still = np.zeros((start, goals.shape[1]))
    return np.concatenate([goals[:start], rows]), np.concatenate([still, rates])


def _approach_begins(velocities: Floats, start: int, met: int) -> int:
    """The last resting row before `met` of velocities (N,n), or `start`."""
    still = np.flatnonzero(np.abs(velocities[start:met]).max(axis=1) < AT_REST)
    return start + int(still[-1]) if len(still) else start

"""Let a planned hand move with a target whose motion is known: the last approach of a plan, carried along at matched velocity."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import SkillRun
from pipeline.expert.reactive.controller import SAME_BRANCH, part_of
from pipeline.planning.failure import PlanFailure
from pipeline.planning.kinematics import ik_many
from pipeline.planning.planner import Planner
from pipeline.poses import Floats, Pose, compose

TRACK = "track"
"""Name of the runs of skills that are carried along."""

KNOTS = 16
"""Physics steps between two poses that are solved; the joints between them follow a cubic spline."""

AT_REST = 1e-3
"""rad/s or m/s; an arm whose joints are all slower rests between two motions."""

STOPPING = 0.06
"""Time constant (s) with which a hand comes to rest after the meeting."""


def carried_along(
    planner: Planner, plan: tuple[Floats, Floats], run: SkillRun, target: Callable[[Floats], Pose], met: int
) -> Floats:
    """Commands (N,A) of a plan of commands and velocities whose arms of `run` move as the target does.

    The plan meets a target that stands at `target(T)`, in row `met`. From where the run's last approach begins the hand is
    displaced as `target(t)` (7,) is from there, before that by a growing part of it, from the start of the run on. After the
    meeting it comes to rest. Raises PlanFailure("track_unreachable").
    """
    commands, velocities = plan
    found, rows = commands.copy(), np.unique([*range(run.start, len(commands), KNOTS), met, len(commands) - 1])
    times = (rows + 1) / PHYSICS_HZ
    meeting = (met + 1) / PHYSICS_HZ
    late = np.maximum(times - meeting, 0.0)
    where = target(np.minimum(times, meeting) + STOPPING * (1 - np.exp(-late / STOPPING)))
    end, column = target(np.array([meeting]))[0], 0
    for side in planner.embodiment.sides:
        n = len(planner.home(side))
        if side in run.arms:
            near = _approach_begins(velocities[:, column : column + n], run.start, met)
            share = np.clip((rows - run.start) / max(1, near - run.start), 0.0, 1.0)
            share = share * share * (3 - 2 * share)
            shift, shifts = np.zeros(n), list[Floats]()
            for row, pose, part in zip(rows, where, share, strict=True):
                q = commands[row, column : column + n]
                goal = compose(part_of(end, pose, part), planner.fk(side, q))
                solved, ok = ik_many(planner.chains[side], goal[None], (q + shift)[None], SAME_BRANCH)
                if not ok[0]:
                    raise PlanFailure("track_unreachable", f"the {side} arm cannot move along with the target")
                shift = solved[0] - q
                shifts.append(shift)
            spline = CubicSpline(rows, np.array(shifts), bc_type="clamped")
            found[run.start :, column : column + n] += spline(np.arange(run.start, len(commands)))
        column += n + 1
    return found


def _approach_begins(velocities: Floats, start: int, met: int) -> int:
    """The last row before `met` in which joints of velocities (N,n) rest, or `start`."""
    still = np.flatnonzero(np.abs(velocities[start:met]).max(axis=1) < AT_REST)
    return start + int(still[-1]) if len(still) else start

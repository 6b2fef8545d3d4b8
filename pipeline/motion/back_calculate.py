"""Find a motion that brings the target to the meeting on time."""

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.motion.judge import REASONS, Limits, SpeedBound, Visible, exact_reason, judge
from pipeline.motion.levels import DRAW, Paths
from pipeline.motion.target_motion import Segment, TargetMotion
from pipeline.motion.workspace import Workspace

BATCH = 128

Free = Callable[[TargetMotion], bool]


class NoMotion(Exception):
    """No candidate was acceptable. `counts` maps those of `REASONS` that occurred to how many candidates they rejected."""

    def __init__(self, level: int, alpha: float, duration: float, counts: dict[str, int]) -> None:
        self.counts = counts
        said = ", ".join(f"{reason} {n}" for reason, n in counts.items()) or "no candidate was allowed"
        super().__init__(f"no motion of level {level} at alpha {alpha:g} m/s over {duration:.3g} s: {said}")


def draw_motion(
    level: int,
    alpha: float,
    duration: float,
    end_pose: ArrayLike,
    workspace: Workspace,
    rng: np.random.Generator,
    *,
    visible: Visible | None = None,
    free: Free | None = None,
    lead: float = 0.0,
    tail: float = 0.0,
    speed_bound: SpeedBound = "average",
    end_speed_limit: float | None = None,
    max_candidates: int = 1000,
) -> TargetMotion:
    """The first acceptable motion (appendix D.3) that is at `end_pose` (7,) at t = `duration` s.

    Level 0 and alpha 0 give the target that stands there, unchecked and without drawing from `rng`. Otherwise the motion is
    back-calculated for `lead` + `duration`, so that it starts at t = -lead and still meets on time. It is accepted if it

    - ends at the end position (level 3: "miss") and, at level 3, changes velocity abruptly at a breakpoint ("smooth");
    - has an average speed, or with `speed_bound="maximum"` an instantaneous speed, of at most alpha ("speed"), and, where
      `end_speed_limit` (m/s) is given, at most that speed at the meeting ("end_speed");
    - stays inside `workspace` under the quadrant rule of `Workspace.guarded` ("workspace") and, going straight on for `tail` s
      after the meeting, inside the plain rectangle ("tail");
    - is seen: `visible(points (N,K,3)) -> (N,)`, called on what is left of a batch with samples of each path, both its ends and
      the end of its tail among them ("visibility");
    - is free: `free(motion)`, called last, for one candidate after another in the order drawn ("blocked").

    Raises NoMotion after `max_candidates`, or at once where the end itself lies outside the workspace ("end_outside"), and
    ValueError for an unknown level, an unknown speed bound, or a duration, alpha, lead or tail that is not a sensible number.
    """
    if level != 0 and level not in DRAW:
        raise ValueError(f"level {level!r} is unknown: levels are 0, {', '.join(map(str, DRAW))}")
    if not (np.isfinite([alpha, duration, lead]).all() and alpha >= 0 and duration > 0 and lead >= 0):
        raise ValueError(f"alpha and lead must be >= 0 and duration > 0: {alpha=}, {duration=}, {lead=}")
    end_pose = np.asarray(end_pose, float)
    limits = Limits(workspace, end_pose[:3], level, alpha, lead + duration, speed_bound, end_speed_limit, tail, visible)
    if level == 0 or alpha == 0:
        return TargetMotion.still(end_pose, duration, lead)
    if not workspace.contains(end_pose):
        raise NoMotion(level, alpha, duration, {"end_outside": 1})
    counts: Counter[str] = Counter()
    for first in range(0, max_candidates, BATCH):
        paths = DRAW[level](rng, min(BATCH, max_candidates - first), alpha, limits.total, end_pose[:2], workspace)
        reasons = judge(paths, limits)
        for i in np.flatnonzero(reasons == ""):
            motion = _motion(paths, int(i), level, alpha, duration, lead, end_pose)
            reasons[i] = exact_reason(motion, limits)
            if not reasons[i] and (free is None or free(motion)):
                return motion
            reasons[i] = reasons[i] or "blocked"
        counts.update(reasons.tolist())
    raise NoMotion(level, alpha, duration, {reason: counts[reason] for reason in REASONS if counts[reason]})


def _motion(
    paths: Paths, i: int, level: int, alpha: float, duration: float, lead: float, end_pose: NDArray[np.float64]
) -> TargetMotion:
    used = int((paths.durations[i] > 0).sum())
    edges = [0.0 - lead, *(np.cumsum(paths.durations[i, : used - 1]) - lead).tolist(), duration]
    pieces = []
    for start, end, c in zip(edges[:-1], edges[1:], paths.coefficients[i], strict=False):
        terms = int(np.flatnonzero(c.any(axis=0)).max(initial=0)) + 1
        pieces.append(Segment(start, end, c[:, :terms]))
    return TargetMotion(level, alpha, duration, lead, float(end_pose[2]), end_pose[3:], tuple(pieces))

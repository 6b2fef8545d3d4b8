"""Find a motion that brings the target to the meeting on time.

A motion is drawn in two steps. The law of its level (appendix D.3 of the paper) gives its shape,
and with it all its speeds; then the shape is turned about the meeting place until it lies where it
may. A shape that fits in no direction is not replaced by a slower one, which would fit more often:
the attempt fails, and the next one has another layout. So accepted speeds follow the law.
"""

from collections import Counter
from dataclasses import replace

import numpy as np

from pipeline.motion.contract import Free, MotionRequest, NoMotion, Streams
from pipeline.motion.planar.judge import (
    REASONS,
    MotionLimits,
    exact_place,
    exact_speed,
    judge_places,
    judge_shapes,
)
from pipeline.motion.planar.levels import DRAW, DrawnPaths, turned
from pipeline.motion.planar.motion import PlanarMotion, Segment

BATCH = 128
TURNS = 256
"""Directions tried of a shape, spread evenly over the circle."""


def draw_motion(asked: MotionRequest, streams: Streams) -> PlanarMotion:
    """A motion (appendix D.3) of level 1, 2 or 3 that keeps `asked`.

    The motion is back-calculated for `lead` + `duration`, so that it starts at t = -lead and still
    meets on time.

    The shape is the first of at most `candidates` that

    - ends at the end position (level 3: "miss") and, at level 3, changes velocity abruptly at a
      breakpoint ("smooth"), where `jump_limit` (m/s) is given by at most that ("jump");
    - has an average speed, or with `speed_bound="maximum"` an instantaneous speed, of at most alpha
      ("speed"), and, where `end_speed_limit` (m/s) is given, at most that speed at the meeting
      ("end_speed");
    - lies inside `workspace` as it was drawn, or is straight and not too long to lie there in some
      direction ("workspace").

    It takes the first of 256 directions, and of both mirror images where it is curved, in which it

    - stays inside `workspace` under the quadrant rule of `Workspace.guarded` ("workspace") and,
      going straight on for `tail` s after the meeting, inside the plain rectangle ("tail");
    - is seen: `visible(points (N,K,3)) -> (N,)`, called on what is left of a batch with samples of
      each path, both its ends and the end of its tail among them ("visibility");
    - is free: `free(motion)`, called last, for one direction after another in the order drawn
      ("blocked").

    Raises NoMotion if there is no such shape or direction, or if the end itself lies outside the
    workspace ("end_outside"), and ValueError for an unknown speed bound or a tail that is not a
    sensible number.
    """
    end_pose = np.asarray(asked.end_pose, float)
    limits = MotionLimits(
        asked.workspace,
        end_pose[:3],
        asked.level,
        asked.alpha,
        asked.lead + asked.duration,
        asked.speed_bound,
        asked.end_speed_limit,
        asked.tail,
        asked.visible,
        asked.jump_limit,
    )
    if not asked.workspace.contains(end_pose):
        raise NoMotion(asked, {"end_outside": 1})
    still = replace(
        PlanarMotion.still(end_pose, asked.duration, asked.lead),
        level=asked.level,
        alpha=asked.alpha,
    )
    counts: Counter[str] = Counter()
    shape = _shape(limits, still, streams.shape, asked.candidates, counts)
    if shape is None:
        raise NoMotion(asked, _ordered(counts))
    motion = _placed(shape, limits, still, streams.direction, asked.free, counts)
    if motion is None:
        raise NoMotion(asked, _ordered(counts), _motion(shape, 0, still).features())
    return motion


def _shape(
    limits: MotionLimits,
    still: PlanarMotion,
    rng: np.random.Generator,
    candidates: int,
    counts: Counter[str],
) -> DrawnPaths | None:
    """The first acceptable shape (one path); what is refused is counted."""
    for first in range(0, candidates, BATCH):
        paths = DRAW[limits.level](
            rng,
            min(BATCH, candidates - first),
            limits.alpha,
            limits.total,
            limits.end[:2],
            limits.workspace,
        )
        reasons = judge_shapes(paths, limits)
        for i in np.flatnonzero(reasons == ""):
            if exact_speed(_motion(paths, int(i), still), limits):
                counts.update(reasons[: int(i)].tolist())
                return paths.only(int(i))
            reasons[i] = "speed"
        counts.update(reasons.tolist())
    return None


def _placed(
    shape: DrawnPaths,
    limits: MotionLimits,
    still: PlanarMotion,
    rng: np.random.Generator,
    free: Free | None,
    counts: Counter[str],
) -> PlanarMotion | None:
    """The shape in the first direction that is acceptable; the others are counted."""
    angles = rng.permutation((np.arange(TURNS) + rng.random()) * (2 * np.pi / TURNS))
    mirrored = rng.random(TURNS) < 0.5
    as_drawn = int(rng.integers(TURNS))
    angles[as_drawn], mirrored[as_drawn] = 0.0, False
    for mirror in (mirrored,) if limits.level == 1 else (mirrored, ~mirrored):
        paths = turned(shape, angles, mirror, limits.end[:2])
        reasons = judge_places(paths, limits)
        for i in np.flatnonzero(reasons == ""):
            motion = _motion(paths, int(i), still)
            if not exact_place(motion, limits):
                reasons[i] = "workspace"
            elif free is None or free(motion):
                return motion
            else:
                reasons[i] = "blocked"
        counts.update(reasons.tolist())
    return None


def _ordered(counts: Counter[str]) -> dict[str, int]:
    return {reason: counts[reason] for reason in REASONS if counts[reason]}


def _motion(paths: DrawnPaths, i: int, still: PlanarMotion) -> PlanarMotion:
    """Path `i` as a motion; everything but its segments is that of `still`."""
    used, lead = int((paths.durations[i] > 0).sum()), still.lead
    edges = [
        0.0 - lead,
        *(np.cumsum(paths.durations[i, : used - 1]) - lead).tolist(),
        still.duration,
    ]
    pieces = []
    for start, end, c in zip(edges[:-1], edges[1:], paths.coefficients[i], strict=False):
        terms = int(np.flatnonzero(c.any(axis=0)).max(initial=0)) + 1
        pieces.append(Segment(start, end, c[:, :terms]))
    return replace(still, segments=tuple(pieces))

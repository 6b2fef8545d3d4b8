"""Find a motion that brings the target to the meeting on time.

The law of a level (appendix D.3 of the paper) gives a shape, and with it all speeds; then the shape
is turned about the meeting place until it lies where it may. A shape that fits in no direction is
not replaced by a slower one: the attempt fails. So accepted speeds follow the law.
"""

from collections import Counter
from dataclasses import replace

import numpy as np

from pipeline.motion.contract import MotionRequest, NoMotion, Streams
from pipeline.motion.planar.judge import (
    REASONS,
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

    The shape is the first of at most `candidates` that

    - ends at the end position (level 3: "miss") and, at level 3, changes velocity abruptly at a
    breakpoint ("smooth"), by at most `jump_limit` where it is given ("jump"); - keeps the bound of
    its speed ("speed") and the `end_speed_limit` ("end_speed"); - lies inside `workspace` as it was
    drawn, or is straight and not too long to lie there in some direction ("workspace").

    It takes the first of 256 directions, and of both mirror images where it is curved, in which it

    - stays inside `workspace` under the quadrant rule of `Workspace.guarded` ("workspace") and for
    the `tail` inside the plain rectangle ("tail"); - is seen: `visible` is asked about what is left
    of a batch ("visibility"); - is free: `free` is asked last, for one direction after another
    ("blocked").

    Raises NoMotion if there is no such shape or direction, or if the end itself lies outside the
    workspace ("end_outside").
    """
    end_pose = np.asarray(asked.end_pose, float)
    if not asked.workspace.contains(end_pose):
        raise NoMotion(asked, {"end_outside": 1})
    still = replace(
        PlanarMotion.still(end_pose, asked.duration, asked.lead),
        level=asked.level,
        alpha=asked.alpha,
    )
    counts: Counter[str] = Counter()
    shape = _shape(asked, still, streams.shape, counts)
    if shape is None:
        raise NoMotion(asked, _ordered(counts))
    motion = _placed(asked, shape, still, streams.direction, counts)
    if motion is None:
        raise NoMotion(asked, _ordered(counts), _motion(shape, 0, still).features())
    return motion


def _shape(
    asked: MotionRequest, still: PlanarMotion, rng: np.random.Generator, counts: Counter[str]
) -> DrawnPaths | None:
    """The first acceptable shape (one path); what is refused is counted."""
    for first in range(0, asked.candidates, BATCH):
        paths = DRAW[asked.level](
            rng,
            min(BATCH, asked.candidates - first),
            asked.alpha,
            asked.total,
            asked.end[:2],
            asked.workspace,
        )
        reasons = judge_shapes(paths, asked)
        for i in np.flatnonzero(reasons == ""):
            if exact_speed(_motion(paths, int(i), still), asked):
                counts.update(reasons[: int(i)].tolist())
                return paths.only(int(i))
            reasons[i] = "speed"
        counts.update(reasons.tolist())
    return None


def _placed(
    asked: MotionRequest,
    shape: DrawnPaths,
    still: PlanarMotion,
    rng: np.random.Generator,
    counts: Counter[str],
) -> PlanarMotion | None:
    """The shape in the first direction that is acceptable; the others are counted."""
    angles = rng.permutation((np.arange(TURNS) + rng.random()) * (2 * np.pi / TURNS))
    mirrored = rng.random(TURNS) < 0.5
    as_drawn = int(rng.integers(TURNS))
    angles[as_drawn], mirrored[as_drawn] = 0.0, False
    for mirror in (mirrored,) if asked.level == 1 else (mirrored, ~mirrored):
        paths = turned(shape, angles, mirror, asked.end[:2])
        reasons = judge_places(paths, asked)
        for i in np.flatnonzero(reasons == ""):
            motion = _motion(paths, int(i), still)
            if not exact_place(motion, asked):
                reasons[i] = "workspace"
            elif asked.free is None or asked.free(motion):
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

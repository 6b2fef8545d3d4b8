"""The paper's motions, in x and y at constant height and orientation."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Bools, Floats

from ..contract import MotionRequest, NoMotion, Streams, described
from ..planar import PlanarMotion, Segment, derivative, evaluate, quadrature
from ..planar_shapes import DRAW, DrawnPaths, turned
from . import register

BATCH = 128
TURNS = 256  # directions tried of a shape, spread evenly over the circle
# Of alpha, the least jump at a level-3 breakpoint: a turn of 11 degrees at full speed, at alpha 0.1
# m/s about one pixel per frame. A smaller step looks like level 2.
ABRUPT = 0.2
# level 1 is often clipped to exactly alpha, which arithmetic returns give or take some 1e-16
SPEED_ROUNDING = 1e-9
POINTS = 24
NODES = np.concatenate([[0.0], quadrature(POINTS)[0], [1.0]])
REASONS = (
    *("end_outside", "miss", "smooth", "jump", "speed", "end_speed", "workspace", "tail"),
    *("visibility", "blocked"),
)


def judge_shapes(paths: DrawnPaths, asked: MotionRequest) -> NDArray[np.object_]:
    """First reason (N,) against each path as drawn, "" for none. A straight path is refused for the
    workspace only if no direction has room."""
    speeds = _speeds(paths, asked.total)
    speed = speeds.average if asked.speed_bound == "average" else speeds.maximum
    checks = {"miss": ~paths.missed, "speed": speed <= asked.alpha * (1 + SPEED_ROUNDING)}
    if asked.level == 1:
        inside = asked.workspace.guarded(asked.end[:2])
        farthest = np.maximum(asked.end[:2] - inside.lower, inside.upper - asked.end[:2])
        room = np.linalg.norm(farthest, axis=-1)
        way = paths.coefficients[:, 0, :, 0] - asked.end[:2]
        checks["workspace"] = np.linalg.norm(way, axis=-1) <= room
    else:
        inside = asked.workspace.guarded(asked.end[:2]).contains(_samples(paths))
        checks["workspace"] = np.asarray(inside.all(-1))
    if asked.level == 3:
        checks["smooth"] = speeds.abrupt >= ABRUPT * asked.alpha
        if asked.jump_limit is not None:
            checks["jump"] = speeds.abrupt <= asked.jump_limit
    if asked.end_speed_limit is not None:
        checks["end_speed"] = np.linalg.norm(speeds.end_velocity, axis=-1) <= asked.end_speed_limit
    return _first_reasons(checks)


def judge_places(paths: DrawnPaths, asked: MotionRequest) -> NDArray[np.object_]:
    """First reason (N,) against each path where it lies, "" for none."""
    points = _samples(paths)
    last = asked.end[:2] + _speeds(paths, asked.total).end_velocity * asked.tail
    checks = {
        "workspace": asked.workspace.guarded(asked.end[:2]).contains(points).all(-1),
        "tail": asked.workspace.contains(last),
    }
    reasons = _first_reasons(checks)
    left = np.flatnonzero(reasons == "")
    if asked.visible is not None and len(left):
        xy = np.concatenate([points[left], last[left, None]], axis=1)
        z = np.full((*xy.shape[:2], 1), asked.end[2])
        seen = asked.visible(np.concatenate([xy, z], axis=-1))
        reasons[left[~np.asarray(seen, bool)]] = "visibility"
    return reasons


def _first_reasons(checks: dict[str, Bools]) -> NDArray[np.object_]:
    reasons = np.full(len(next(iter(checks.values()))), "", dtype=object)
    for reason in (r for r in reversed(REASONS) if r in checks):
        reasons[~np.asarray(checks[reason])] = reason
    return reasons


class _Speeds(NamedTuple):
    """Average, maximum, greatest jump, end velocity of N paths in m/s."""

    average: Floats
    maximum: Floats
    abrupt: Floats
    end_velocity: Floats


def _speeds(paths: DrawnPaths, total: float) -> _Speeds:
    slopes = derivative(paths.coefficients)
    used = paths.durations > 0
    spans = np.where(used, paths.durations, np.inf)[..., None]
    speed = np.linalg.norm(evaluate(slopes[:, :, None], NODES[:, None]), axis=-1)
    average = (speed[..., 1:-1] * quadrature(POINTS)[1]).sum((-1, -2)) / total
    leaving, entering = evaluate(slopes, 1.0) / spans, evaluate(slopes, 0.0) / spans
    jumps = np.where(used[:, 1:], np.linalg.norm(entering[:, 1:] - leaving[:, :-1], axis=-1), 0.0)
    rows = np.arange(len(used))
    greatest, last = (speed / spans).max((-1, -2)), leaving[rows, used.sum(-1) - 1]
    return _Speeds(average, greatest, jumps.max(-1, initial=0.0), last)


def _samples(paths: DrawnPaths) -> Floats:
    """Points (N, K, 2); unused pieces repeat the path's end."""
    points = evaluate(paths.coefficients[:, :, None], NODES[:, None])
    used = paths.durations > 0
    ends = points[np.arange(len(used)), used.sum(-1) - 1, -1]
    return np.where(used[..., None, None], points, ends[:, None, None]).reshape(len(points), -1, 2)


def draw_motion(asked: MotionRequest, streams: Streams) -> PlanarMotion:
    """A motion (appendix D.3) that keeps `asked`, else NoMotion. The first shape that
    `judge_shapes` accepts is turned in 256 directions, and mirrored if curved; no slower one
    replaces it, so that speeds follow the law."""
    end_pose = np.asarray(asked.end_pose, float)
    if not asked.workspace.contains(end_pose):
        raise NoMotion(asked, {"end_outside": 1})
    still = PlanarMotion.still(end_pose, asked.duration, asked.lead)
    still = replace(still, level=asked.level, alpha=asked.alpha)
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
    for first in range(0, asked.candidates, BATCH):
        paths = DRAW[asked.level](rng, min(BATCH, asked.candidates - first), asked)
        reasons = judge_shapes(paths, asked)
        for i in np.flatnonzero(reasons == ""):
            motion = _motion(paths, int(i), still)
            average = asked.speed_bound == "average"
            speed = motion.average_speed() if average else motion.maximum_speed()
            if speed <= asked.alpha * (1 + SPEED_ROUNDING):  # samples may miss it by a hair
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
    angles = rng.permutation((np.arange(TURNS) + rng.random()) * (2 * np.pi / TURNS))
    mirrored = rng.random(TURNS) < 0.5
    as_drawn = int(rng.integers(TURNS))
    angles[as_drawn], mirrored[as_drawn] = 0.0, False
    for mirror in (mirrored,) if asked.level == 1 else (mirrored, ~mirrored):
        paths = turned(shape, angles, mirror, asked.end[:2])
        reasons = judge_places(paths, asked)
        for i in np.flatnonzero(reasons == ""):
            motion = _motion(paths, int(i), still)
            inside = asked.workspace.guarded(asked.end[:2])
            if not inside.contains(np.stack(motion.extent())).all():  # nor may samples miss it
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
    used, lead = int((paths.durations[i] > 0).sum()), still.lead
    breaks = (np.cumsum(paths.durations[i, : used - 1]) - lead).tolist()
    edges = [0.0 - lead, *breaks, still.duration]
    pieces = []
    for start, end, c in zip(edges[:-1], edges[1:], paths.coefficients[i], strict=False):
        terms = int(np.flatnonzero(c.any(axis=0)).max(initial=0)) + 1
        pieces.append(Segment(start, end, c[:, :terms]))
    return replace(still, segments=tuple(pieces))


class Planar:
    name = "planar"
    version = 1
    levels = described("constant velocity", "polynomial", "two or three abrupt segments")

    draw = staticmethod(draw_motion)

    def stand(self, asked: MotionRequest, streams: Streams) -> PlanarMotion:
        return PlanarMotion.still(asked.end_pose, asked.duration, asked.lead)

    def read(self, values: Mapping[str, Any]) -> PlanarMotion:
        return PlanarMotion.from_values(values)


register(Planar())

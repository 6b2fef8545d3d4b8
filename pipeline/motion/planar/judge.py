"""Which candidates of a batch are acceptable, and the first reason why each of the others is
not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.motion.contract import MotionRequest
from pipeline.motion.planar.levels import DrawnPaths
from pipeline.motion.planar.motion import PlanarMotion
from pipeline.motion.planar.polynomials import derivative, evaluate, quadrature

# Level 3 must turn or change pace by a fifth of alpha at one breakpoint at least: a turn of 11
# degrees at full speed, and at alpha 0.1 m/s about one pixel per frame in the head camera. A
# smaller step looks like level 2 and would be mislabelled.
ABRUPT = 0.2
# Level 1 is often clipped to exactly alpha, which its arithmetic then returns give or take some
# 1e-16.
SPEED_ROUNDING = 1e-9
NODES = 24
REASONS = (
    "end_outside",
    "miss",
    "smooth",
    "jump",
    "speed",
    "end_speed",
    "workspace",
    "tail",
    "visibility",
    "blocked",
)

Array = NDArray[np.float64]


def judge_shapes(paths: DrawnPaths, asked: MotionRequest) -> NDArray[np.object_]:
    """First reason (N,) against each path as the law draws it: miss, smooth, jump, speed,
    end_speed, or "workspace"; "" for none. A straight path is refused for the workspace only
    where no direction has room for it."""
    speeds = _speeds(paths, asked.total)
    speed = speeds.average if asked.speed_bound == "average" else speeds.maximum
    checks = {"miss": ~paths.missed, "speed": speed <= asked.alpha * (1 + SPEED_ROUNDING)}
    if asked.level == 1:
        room = np.linalg.norm(_corners(asked) - asked.end[:2], axis=-1).max()
        checks["workspace"] = (
            np.linalg.norm(paths.coefficients[:, 0, :, 0] - asked.end[:2], axis=-1) <= room
        )
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
    """First reason (N,) against each path where it lies, "" for none: workspace, tail, visibility.
    `asked.visible` is asked only about the paths that the others leave."""
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
        seen = asked.visible(
            np.concatenate([xy, np.full((*xy.shape[:2], 1), asked.end[2])], axis=-1)
        )
        reasons[left[~np.asarray(seen, bool)]] = "visibility"
    return reasons


def exact_speed(motion: PlanarMotion, asked: MotionRequest) -> bool:
    """Whether a motion keeps the speed bound by its closed form, which samples may miss by a
    hair."""
    speed = motion.average_speed() if asked.speed_bound == "average" else motion.maximum_speed()
    return speed <= asked.alpha * (1 + SPEED_ROUNDING)


def exact_place(motion: PlanarMotion, asked: MotionRequest) -> bool:
    """Whether a motion stays in the workspace by its closed form, which samples may miss by a
    hair."""
    return bool(asked.workspace.guarded(asked.end[:2]).contains(np.stack(motion.extent())).all())


def _first_reasons(checks: dict[str, NDArray[np.bool_]]) -> NDArray[np.object_]:
    reasons = np.full(len(next(iter(checks.values()))), "", dtype=object)
    for reason in (r for r in reversed(REASONS) if r in checks):
        reasons[~np.asarray(checks[reason])] = reason
    return reasons


def _corners(asked: MotionRequest) -> Array:
    """Corners (4, 2) of the part of the workspace in which the path must stay."""
    inside = asked.workspace.guarded(asked.end[:2])
    (x0, y0), (x1, y1) = inside.lower, inside.upper
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


@dataclass(frozen=True, eq=False)
class _Speeds:
    """Of N paths in m/s: average (N,), maximum (N,), greatest jump (N,), velocity at the end (N,
    2)."""

    average: Array
    maximum: Array
    abrupt: Array
    end_velocity: Array


def _speeds(paths: DrawnPaths, total: float) -> _Speeds:
    slopes = derivative(paths.coefficients)
    used = paths.durations > 0
    spans = np.where(used, paths.durations, np.inf)[..., None]
    speed = np.linalg.norm(evaluate(slopes[:, :, None], _nodes()[:, None]), axis=-1)
    average = (speed[..., 1:-1] * quadrature(NODES)[1]).sum((-1, -2)) / total
    leaving, entering = evaluate(slopes, 1.0) / spans, evaluate(slopes, 0.0) / spans
    jumps = np.where(used[:, 1:], np.linalg.norm(entering[:, 1:] - leaving[:, :-1], axis=-1), 0.0)
    rows = np.arange(len(used))
    return _Speeds(
        average,
        (speed / spans).max((-1, -2)),
        jumps.max(-1, initial=0.0),
        leaving[rows, used.sum(-1) - 1],
    )


def _samples(paths: DrawnPaths) -> Array:
    """Points (N, K, 2) along the paths; pieces that a path does not use repeat its end."""
    points = evaluate(paths.coefficients[:, :, None], _nodes()[:, None])
    used = paths.durations > 0
    ends = points[np.arange(len(used)), used.sum(-1) - 1, -1]
    return np.where(used[..., None, None], points, ends[:, None, None]).reshape(len(points), -1, 2)


def _nodes() -> Array:
    return np.concatenate([[0.0], quadrature(NODES)[0], [1.0]])

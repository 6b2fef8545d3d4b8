"""Which candidates of a batch are acceptable, and the first reason why each of the others is
not."""

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.motion.contract import SpeedBound, Visible
from pipeline.motion.planar.levels import DrawnPaths
from pipeline.motion.planar.motion import PlanarMotion
from pipeline.motion.planar.polynomials import derivative, evaluate, quadrature
from pipeline.motion.workspace import Workspace

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


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """What a path must keep to: see `Request`. `end` (3,) in m; `total` is lead + duration in s.
    Raises ValueError for an unknown speed bound and a tail or end speed limit that is negative or
    not finite."""

    workspace: Workspace
    end: Array
    level: int
    alpha: float
    total: float
    speed_bound: SpeedBound = "average"
    end_speed_limit: float | None = None
    tail: float = 0.0
    visible: Visible | None = None
    jump_limit: float | None = None

    def __post_init__(self) -> None:
        if self.speed_bound not in get_args(SpeedBound):
            raise ValueError(
                f"speed_bound {self.speed_bound!r} is unknown: use"
                f" {' or '.join(get_args(SpeedBound))}"
            )
        limits = {
            "tail": self.tail,
            "end_speed_limit": self.end_speed_limit or 0.0,
            "jump_limit": self.jump_limit or 0.0,
        }
        for name, value in limits.items():
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must be finite and not negative: {value}")


def judge_shapes(paths: DrawnPaths, limits: MotionLimits) -> NDArray[np.object_]:
    """First reason (N,) against each path as the law draws it, wherever it may be turned later; ""
    for none.

    Judged are miss, smooth, jump, speed and end_speed, which no turn can change, and "workspace":
    the paper draws a curved path inside the workspace, but a straight one in any direction, so that
    this one is refused only where no direction has room for it.
    """
    speeds = _speeds(paths, limits.total)
    speed = speeds.average if limits.speed_bound == "average" else speeds.maximum
    checks = {"miss": ~paths.missed, "speed": speed <= limits.alpha * (1 + SPEED_ROUNDING)}
    if limits.level == 1:
        room = np.linalg.norm(_corners(limits) - limits.end[:2], axis=-1).max()
        checks["workspace"] = (
            np.linalg.norm(paths.coefficients[:, 0, :, 0] - limits.end[:2], axis=-1) <= room
        )
    else:
        inside = limits.workspace.guarded(limits.end[:2]).contains(_samples(paths))
        checks["workspace"] = np.asarray(inside.all(-1))
    if limits.level == 3:
        checks["smooth"] = speeds.abrupt >= ABRUPT * limits.alpha
        if limits.jump_limit is not None:
            checks["jump"] = speeds.abrupt <= limits.jump_limit
    if limits.end_speed_limit is not None:
        checks["end_speed"] = np.linalg.norm(speeds.end_velocity, axis=-1) <= limits.end_speed_limit
    return _first_reasons(checks)


def judge_places(paths: DrawnPaths, limits: MotionLimits) -> NDArray[np.object_]:
    """First reason (N,) against each path where it lies, "" for none: workspace, tail, visibility.
    `limits.visible` is asked only about the paths that the others leave."""
    points = _samples(paths)
    last = limits.end[:2] + _speeds(paths, limits.total).end_velocity * limits.tail
    checks = {
        "workspace": limits.workspace.guarded(limits.end[:2]).contains(points).all(-1),
        "tail": limits.workspace.contains(last),
    }
    reasons = _first_reasons(checks)
    left = np.flatnonzero(reasons == "")
    if limits.visible is not None and len(left):
        xy = np.concatenate([points[left], last[left, None]], axis=1)
        seen = limits.visible(
            np.concatenate([xy, np.full((*xy.shape[:2], 1), limits.end[2])], axis=-1)
        )
        reasons[left[~np.asarray(seen, bool)]] = "visibility"
    return reasons


def exact_speed(motion: PlanarMotion, limits: MotionLimits) -> bool:
    """Whether a motion keeps the speed bound by its closed form, which the samples of
    `judge_shapes` may miss by a hair."""
    speed = motion.average_speed() if limits.speed_bound == "average" else motion.maximum_speed()
    return speed <= limits.alpha * (1 + SPEED_ROUNDING)


def exact_place(motion: PlanarMotion, limits: MotionLimits) -> bool:
    """Whether a motion stays in the workspace by its closed form, which the samples of
    `judge_places` may miss by a hair."""
    return bool(limits.workspace.guarded(limits.end[:2]).contains(np.stack(motion.extent())).all())


def _first_reasons(checks: dict[str, NDArray[np.bool_]]) -> NDArray[np.object_]:
    reasons = np.full(len(next(iter(checks.values()))), "", dtype=object)
    for reason in (r for r in reversed(REASONS) if r in checks):
        reasons[~np.asarray(checks[reason])] = reason
    return reasons


def _corners(limits: MotionLimits) -> Array:
    """Corners (4, 2) of the part of the workspace in which the path must stay."""
    inside = limits.workspace.guarded(limits.end[:2])
    (x0, y0), (x1, y1) = inside.lower, inside.upper
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


@dataclass(frozen=True, eq=False)
class _Speeds:
    """Of N paths in m/s: average (N,), maximum (N,), greatest jump at a breakpoint (N,), velocity
    at the end (N, 2)."""

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

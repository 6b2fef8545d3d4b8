"""From waypoints to joint rows at the physics rate, at rest at both ends; two waypoints are a
straight move with a trapezoidal speed profile.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from pipeline.data.clock import PHYSICS_HZ
from pipeline.poses import Floats

from .budgets import LIMITS
from .failure import PlanFailure
from .timing import fastest


class Trajectory(NamedTuple):
    """Joints q (M,n) and joint velocities qd (M,n) at the physics rate."""

    q: Floats
    qd: Floats


@dataclass(frozen=True, eq=False)
class ArmTrajectory:
    """Joints and velocities (M,n), gripper values (M,), at the physics rate."""

    q: Floats
    qd: Floats
    gripper: Floats

    def then(self, other: "ArmTrajectory") -> "ArmTrajectory":
        both = ((self.q, other.q), (self.qd, other.qd), (self.gripper, other.gripper))
        return ArmTrajectory(*(np.concatenate(rows) for rows in both))

    def holding(self, seconds: float) -> "ArmTrajectory":
        rows = round(seconds * PHYSICS_HZ)
        still = np.zeros((rows, self.qd.shape[1]))
        end = self.q[-1:].repeat(rows, 0), still, self.gripper[-1:].repeat(rows)
        return self.then(ArmTrajectory(*end))


def time_parameterise(
    waypoints: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    *,
    minimum_duration: float = 0.0,
    deviation: float = LIMITS.deviations[0],
) -> Trajectory:
    """Timed rows through `waypoints` (K,n), in rad and s. Corners are rounded by at most
    `deviation` (rad or m). Raises PlanFailure("time_parameterisation").
    """
    corners = np.atleast_2d(np.asarray(waypoints, float))
    v, a = np.asarray(velocity, float), np.asarray(acceleration, float)
    if not (np.isfinite(corners).all() and (v > 0).all() and (a > 0).all()):
        raise PlanFailure("time_parameterisation", "waypoints must be finite and limits positive")
    kept = [corners[0]]  # without repeats
    for corner in corners[1:]:
        if np.abs(corner - kept[-1]).max() > LIMITS.same:
            kept.append(corner)
    if len(kept) > 1:
        kept[-1] = corners[-1]
    corners = np.array(kept)
    if len(corners) == 1:
        rows = _rows(minimum_duration) if minimum_duration > 0 else 1
        return Trajectory(np.repeat(corners, rows, axis=0), np.zeros((rows, len(corners[0]))))
    if len(corners) == 2:
        q, qd = _trapezoid(corners[0], corners[1], v, a, minimum_duration)
    else:
        q, qd = _along(RoundedPolyline(corners, deviation), corners, v, a, minimum_duration)
    q[0], q[-1] = corners[0], corners[-1]
    qd[0] = qd[-1] = 0.0
    return Trajectory(q, qd)


def smoothed(rows: Floats, before: Floats) -> Floats:
    """The moving average of `rows` (N,A) at the physics rate, from rest at `before` (A,), for
    LIMITS.jerk.

    Rows leave the path by 0.6 mrad at most; ones that move until their end get up to a window more.
    """
    window = int(np.ceil(2 * LIMITS.acceleration / LIMITS.jerk * PHYSICS_HZ - 1e-9))
    offset = rows - before
    changes = np.flatnonzero(np.diff(offset, axis=0, prepend=0.0 * before[None]).any(axis=1))
    if not len(changes):
        return rows
    settled = int(changes[-1]) + window - 1
    ahead = np.zeros((window - 1, len(before)))
    behind = np.repeat(offset[-1:], max(0, settled + 1 - len(rows)), axis=0)
    windows = sliding_window_view(np.concatenate([ahead, offset, behind]), window, axis=0)
    out = before + windows.mean(axis=-1)
    out[settled:] = rows[-1]
    return out


class RoundedPolyline:
    """The polyline through `waypoints` (K,n), K >= 2, with parabolas for corners: q(s), C1, q''
    constant between `knots`.

    A parabola from d before to d after its corner misses it by d |u1 - u0| / 4 <= `deviation`.
    """

    def __init__(self, waypoints: Floats, deviation: float) -> None:
        segments = np.diff(waypoints, axis=0)
        lengths = np.abs(segments).max(axis=1)
        u = segments / lengths[:, None]
        turns = np.maximum(np.abs(np.diff(u, axis=0)).max(axis=1), 1e-9)
        cut = np.minimum(4 * deviation / turns, 0.5 * np.minimum(lengths[:-1], lengths[1:]))
        # segment k is a line from after its first corner to before its last, then comes the
        # parabola of that last corner
        trimmed = lengths - np.concatenate([[0.0], cut]) - np.concatenate([cut, [0.0]])
        starts = waypoints[:-1] + np.concatenate([[0.0], cut])[:, None] * u
        bends = waypoints[1:-1] - cut[:, None] * u[:-1]
        n = len(segments)
        span, base = np.empty(2 * n - 1), np.empty((2 * n - 1, waypoints.shape[1]))
        slope, bend = np.empty_like(base), np.zeros_like(base)
        span[0::2], span[1::2] = np.maximum(trimmed, 0.0), 2 * cut
        base[0::2], base[1::2] = starts, bends
        slope[0::2], slope[1::2] = u, u[:-1]
        bend[1::2] = np.diff(u, axis=0) / (4 * cut)[:, None]
        real = span > 1e-9
        self.base, self.slope, self.bend = base[real], slope[real], bend[real]
        self.knots = np.concatenate([[0.0], np.cumsum(span[real])])

    def __call__(self, path_positions: ArrayLike, order: int = 0) -> Floats:
        """q (M,n) at path positions (M,), or a derivative by s."""
        s = np.asarray(path_positions, float)
        k = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.base) - 1)
        t = (s - self.knots[k])[..., None]
        if order == 0:
            return self.base[k] + t * (self.slope[k] + t * self.bend[k])
        return self.slope[k] + 2 * t * self.bend[k] if order == 1 else 2 * self.bend[k]


def _along(
    path: RoundedPolyline, corners: Floats, v: Floats, a: Floats, minimum: float
) -> tuple[Floats, Floats]:
    # at least three points a piece: a bend may force a stop at both knots
    spans = pairwise(path.knots.tolist())
    pieces = [np.linspace(p, q, 5 + int((q - p) / LIMITS.grid))[1:] for p, q in spans]
    s = np.concatenate([path.knots[:1], *pieces])
    x = fastest(s, path(s, 1), path(0.5 * (s[:-1] + s[1:]), 2), v, a)
    speeds, accelerations = np.sqrt(x), np.diff(x) / (2 * np.diff(s))
    if not (speeds[1:-1] > 0).all():
        raise PlanFailure("time_parameterisation", f"a path of {len(corners)} waypoints gets stuck")
    times = np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / (speeds[:-1] + speeds[1:]))])
    duration = float(times[-1])
    if not duration < LIMITS.longest:
        what = f"a path of {len(corners)} waypoints would take {duration:.0f} s"
        raise PlanFailure("time_parameterisation", what)
    rows = max(_rows(duration), _rows(minimum))
    while True:
        t = np.linspace(0.0, duration, rows)
        i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(s) - 2)
        dt = t - times[i]
        at = np.clip(s[i] + speeds[i] * dt + 0.5 * accelerations[i] * dt**2, 0.0, s[-1])
        speed = np.maximum(speeds[i] + accelerations[i] * dt, 0.0)
        q, qd = path(at), path(at, 1) * speed[:, None]
        # Limits hold at grid points only: slow down uniformly by what the samples in between exceed
        # them.
        over = _excess(q, v, a)
        if over <= 1.0 + 1e-9:
            return q, qd * (duration * PHYSICS_HZ / (rows - 1))
        rows = max(rows + 1, _rows((rows - 1) / PHYSICS_HZ * over))


def _excess(q: Floats, v: Floats, a: Floats) -> float:
    """By what factor rows q (M,n) are too fast for limits (n,)."""
    speeds = np.diff(q, axis=0) * PHYSICS_HZ
    changes = np.diff(np.pad(speeds, ((1, 1), (0, 0))), axis=0) * PHYSICS_HZ
    return max(float((np.abs(speeds) / v).max()), float(np.sqrt((np.abs(changes) / a).max())))


def _trapezoid(p: Floats, q: Floats, v: Floats, a: Floats, minimum: float) -> tuple[Floats, Floats]:
    """s from 0 to 1 with speed at most w and acceleration b."""
    span = np.abs(q - p)
    w, b = float((v / np.maximum(span, 1e-12)).min()), float((a / np.maximum(span, 1e-12)).min())
    ramp = min(w / b, np.sqrt(1.0 / b))
    top = b * ramp
    duration = 1.0 / top + ramp
    rows = max(_rows(duration), _rows(minimum))
    t = np.linspace(0.0, duration, rows)
    up, down = np.minimum(t, ramp), np.maximum(t - (duration - ramp), 0.0)
    s = 0.5 * b * up**2 + top * np.maximum(t - ramp, 0.0) - 0.5 * b * down**2
    speed = (b * up - b * down) * (duration * PHYSICS_HZ / (rows - 1))
    return p + s[:, None] * (q - p), speed[:, None] * (q - p)


def _rows(duration: float) -> int:
    """Of at least `duration` s: both ends included, at least two."""
    return 1 + max(1, int(np.ceil(duration * PHYSICS_HZ - 1e-6)))

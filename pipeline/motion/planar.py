"""Planar motion as polynomials on normalised time [0, 1]."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from pipeline.poses import Floats, Pose

from .contract import Features
from .scenery import Prop


@cache
def interpolation(n: int) -> Floats:
    """Matrix (n, n) from values at 0, 1/(n-1), ..., 1 to polynomial coefficients (appendix D.3).
    Lagrange's form makes the digits independent of LAPACK."""
    nodes = np.arange(n) / (n - 1)
    columns = []
    for i, node in enumerate(nodes):
        others = np.delete(nodes, i)
        columns.append(polynomial.polyfromroots(others) / np.prod(node - others))
    matrix = np.stack(columns, axis=1)
    matrix.setflags(write=False)
    return matrix


@cache
def quadrature(n: int) -> tuple[Floats, Floats]:
    """Gauss-Legendre nodes and weights, (n,) each, on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(n)
    nodes, weights = (x + 1) / 2, w / 2
    nodes.setflags(write=False)
    weights.setflags(write=False)
    return nodes, weights


def evaluate(coefficients: ArrayLike, s: Floats | float) -> Floats:
    """Horner's scheme: coefficients (..., d+1) at `s`, broadcast."""
    c = np.asarray(coefficients, float)
    value = c[..., -1] + np.zeros_like(s)
    for k in range(c.shape[-1] - 2, -1, -1):
        value = value * s + c[..., k]
    return value


def derivative(coefficients: ArrayLike) -> Floats:
    """Coefficients (..., max(d, 1)) of the derivative of (..., d+1)."""
    c = np.asarray(coefficients, float)
    if c.shape[-1] == 1:
        return np.zeros_like(c)
    return c[..., 1:] * np.arange(1, c.shape[-1], dtype=np.float64)


def stationary(coefficients: ArrayLike) -> Floats:
    """Sorted times in [0, 1] at which one polynomial (d+1,) can be extreme."""
    slope = derivative(coefficients)
    # leading terms of this size cannot move an extreme, but send roots to infinity
    kept = np.flatnonzero(np.abs(slope) > 1e-14 * np.abs(slope).max())
    slope = slope[: kept.max(initial=0) + 1]
    roots = polynomial.polyroots(slope) if len(slope) > 1 else np.zeros(0)
    # a double root splits into a pair beside the real axis; taking its real part adds a harmless
    # point
    inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > 0) & (roots.real < 1)]
    return np.concatenate([[0.0], np.sort(inside), [1.0]])


def squared_speed(coefficients: ArrayLike) -> Floats:
    """Coefficients of |p'(s)|^2 for a planar curve (2, d+1)."""
    x, y = derivative(coefficients)
    return (np.convolve(x, x) + np.convolve(y, y)).astype(np.float64)


def arc_length(coefficients: ArrayLike) -> float:
    """Length of a planar curve (2, d+1), by Gauss-Legendre between the speed's extremes."""
    slope = derivative(coefficients)
    cuts = stationary(squared_speed(coefficients))
    nodes, weights = quadrature(32)
    width = np.diff(cuts)
    s = cuts[:-1, None] + width[:, None] * nodes
    speed = np.hypot(evaluate(slope[0], s), evaluate(slope[1], s))
    return float(((speed * weights).sum(-1) * width).sum())


def greatest_speed(coefficients: ArrayLike) -> float:
    """Maximum of |p'(s)| over [0, 1] for a planar curve (2, d+1), exact up to rounding."""
    slope = derivative(coefficients)
    s = stationary(squared_speed(coefficients))
    return float(np.hypot(evaluate(slope[0], s), evaluate(slope[1], s)).max())


@dataclass(frozen=True, eq=False)
class Segment:
    """Coefficients (2, d+1) in m over (t - start) / (end - start)."""

    start: float
    end: float
    coefficients: Floats

    def __post_init__(self) -> None:
        c = np.array(self.coefficients, float)
        if c.ndim != 2 or c.shape[0] != 2 or c.shape[1] < 1 or not np.isfinite(c).all():
            raise ValueError(f"segment coefficients must be finite (2, d+1), not {c.shape}")
        if not self.end > self.start:
            raise ValueError(f"a segment must end after it starts: {self.start} to {self.end} s")
        c.setflags(write=False)
        object.__setattr__(self, "coefficients", c)


@dataclass(frozen=True, eq=False)
class PlanarMotion:
    """Polynomial pieces in x and y without a gap, at height `z` (m); the last velocity is kept
    after the meeting. Raises ValueError."""

    level: int
    alpha: float
    duration: float
    lead: float
    z: float
    orientation: Floats
    segments: tuple[Segment, ...]

    def __post_init__(self) -> None:
        q = np.array(self.orientation, float)
        if q.shape != (4,):
            raise ValueError(f"orientation must be a quaternion wxyz, not of shape {q.shape}")
        if not (np.isfinite(self.duration) and self.duration > 0 and np.isfinite(self.lead)):
            given = f"{self.duration} s, {self.lead} s"
            raise ValueError(f"duration must be positive and lead finite: {given}")
        if not self.segments:
            raise ValueError("a motion needs at least one segment")
        edges = [-self.lead, *(s.end for s in self.segments)]
        if edges[-1] != self.duration or any(
            s.start != e for s, e in zip(self.segments, edges, strict=False)
        ):
            raise ValueError("segments must cover the time from -lead to duration without a gap")
        q.setflags(write=False)
        object.__setattr__(self, "orientation", q)
        object.__setattr__(self, "segments", tuple(self.segments))

    @property
    def model(self) -> str:
        return "planar"

    @classmethod
    def still(cls, pose: ArrayLike, duration: float, lead: float = 0.0) -> "PlanarMotion":
        """A target that stands at `pose` (7,) all the time: level 0, alpha 0."""
        p = np.asarray(pose, float)
        segment = Segment(0.0 - lead, duration, p[:2, None])
        return cls(0, 0.0, duration, lead, float(p[2]), p[3:], (segment,))

    @cached_property
    def _table(self) -> tuple[Floats, Floats, Floats, Floats]:
        starts, ends = np.array([(s.start, s.end) for s in self.segments]).T
        terms = max(s.coefficients.shape[1] for s in self.segments)
        c = np.zeros((len(self.segments), 2, terms))
        for row, segment in zip(c, self.segments, strict=True):
            row[:, : segment.coefficients.shape[1]] = segment.coefficients
        spans = ends - starts
        return starts, spans, c, derivative(c) / spans[:, None, None]

    def _locate(self, t: Floats) -> tuple[NDArray[np.intp], Floats]:
        starts, spans, _, _ = self._table
        i = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)
        return i, np.clip((t - starts[i]) / spans[i], 0.0, 1.0)

    def position(self, t: ArrayLike) -> Floats:
        """World position (..., 3) in m at times t (...,) in s."""
        t = np.asarray(t, float)
        i, s = self._locate(t)
        xy = evaluate(self._table[2][i], s[..., None])
        late = np.maximum(t - self.duration, 0.0)[..., None]
        xy = xy + late * self.end_velocity[:2]
        return np.concatenate([xy, np.full((*t.shape, 1), self.z)], -1)

    def velocity(self, t: ArrayLike) -> Floats:
        """World velocity (..., 3) in m/s at `t` (s); after a breakpoint."""
        t = np.asarray(t, float)
        i, s = self._locate(t)
        xy = evaluate(self._table[3][i], s[..., None]) * (t >= -self.lead)[..., None]
        return np.concatenate([xy, np.zeros((*t.shape, 1))], -1)

    def twist(self, t: ArrayLike) -> Floats:
        v = self.velocity(t)
        return np.concatenate([v, np.zeros_like(v)], -1)

    def pose(self, t: ArrayLike) -> Pose:
        p = self.position(t)
        return np.concatenate([p, np.broadcast_to(self.orientation, (*p.shape[:-1], 4))], -1)

    @cached_property
    def end_velocity(self) -> Floats:
        """Velocity (3,) in m/s at the meeting, kept from then on."""
        v = np.array([*evaluate(self._table[3][-1], 1.0), 0.0])
        v.setflags(write=False)
        return v

    def breakpoints(self) -> Floats:
        return np.array([s.start for s in self.segments[1:]])

    def average_speed(self) -> float:
        """Arc length over [-lead, duration] divided by its time, m/s."""
        return sum(arc_length(s.coefficients) for s in self.segments) / (self.duration + self.lead)

    def maximum_speed(self) -> float:
        """Greatest speed over [-lead, duration], m/s, exact up to rounding."""
        return max(greatest_speed(s.coefficients) / (s.end - s.start) for s in self.segments)

    def features(self) -> Features:
        moved = self.position(self.duration) - self.position(-self.lead)
        ends = float(np.linalg.norm(self.end_velocity)), float(np.linalg.norm(moved))
        return Features(self.average_speed(), self.maximum_speed(), *ends)

    def extent(self) -> tuple[Floats, Floats]:
        """Smallest and largest x, y (2,) in m over [-lead, duration]."""
        extremes = [[evaluate(c, stationary(c)) for c in s.coefficients] for s in self.segments]
        low = np.array([[axis.min() for axis in pair] for pair in extremes]).min(0)
        return low, np.array([[axis.max() for axis in pair] for pair in extremes]).max(0)

    def scenery(self) -> tuple[Prop, ...]:
        return ()

    def to_json(self) -> str:
        pieces = [
            {"start": s.start, "end": s.end, "coefficients": s.coefficients.tolist()}
            for s in self.segments
        ]
        scalars = {k: getattr(self, k) for k in ("level", "alpha", "duration", "lead", "z")}
        values = {**scalars, "orientation": self.orientation.tolist(), "segments": pieces}
        return json.dumps(values, allow_nan=False)

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> "PlanarMotion":
        """The motion of what `to_json` wrote. Raises ValueError."""
        try:
            given = {key: value for key, value in values.items() if key != "model"}
            given["segments"] = tuple(Segment(**piece) for piece in values["segments"])
            return cls(**given)
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"this is not a target motion: {error!r}") from error

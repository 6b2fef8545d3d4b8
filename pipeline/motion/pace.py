"""Pace along a path: constant, smoothly or abruptly changing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats

from .contract import MotionRequest, described

LEVELS = described("constant speed", "speed that changes smoothly", "two or three abrupt speeds")

SLOWEST = 0.5  # share of alpha from which, up to 1, the mean speed is drawn

SWELL = (0.4, 0.8)
LEAST_JUMP = 0.4
LEAST_END = 0.3
LEAST_SHARE = 0.15


@dataclass(frozen=True)
class Pace:
    """The advance (m) along a path, 0 at the last of `edges` (s), in pieces from `start` (s). Piece
    k of duration d has the mean speed v = speeds[k] (m/s); at the share u of its time it has
    advanced v d (u + swell sin(pi u) / pi), at the speed v (1 + swell cos(pi u)). The last speed is
    kept."""

    start: float
    edges: tuple[float, ...]
    speeds: tuple[float, ...]
    swell: float = 0.0

    def _pieces(self, t: ArrayLike) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Share, duration and speed of the piece, the advance at its start, time after the last."""
        t = np.asarray(t, float)
        starts, edges = np.array([self.start, *self.edges[:-1]]), np.array(self.edges)
        spans, speeds = edges - starts, np.array(self.speeds)
        done = np.concatenate([[0.0], np.cumsum(spans * speeds)])
        k = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(spans) - 1)
        share = np.clip((t - starts[k]) / spans[k], 0.0, 1.0)
        return share, spans[k], speeds[k], done[k] - done[-1], np.maximum(t - edges[-1], 0.0)

    def advance(self, t: ArrayLike) -> Floats:
        """Advance (m) at times t (...,)."""
        share, span, speed, done, late = self._pieces(t)
        inside = done + speed * span * (share + self.swell * np.sin(np.pi * share) / np.pi)
        return np.where(late > 0, self.speeds[-1] * (1 - self.swell) * late, inside)

    @property
    def way(self) -> float:
        """What is left to advance (m) at the start."""
        return -float(self.advance(np.array(self.start)))

    def rate(self, t: ArrayLike) -> Floats:
        """Speed (m/s) at times t (...,), after an edge where t is one."""
        share, _, speed, _, _ = self._pieces(t)
        return speed * (1 + self.swell * np.cos(np.pi * share))


def two_speeds(asked: MotionRequest, rng: np.random.Generator, share: float, ratio: float) -> Pace:
    """A speed for a `share` of the time, then `ratio` times as fast."""
    first = asked.alpha * float(rng.uniform(SLOWEST, 1.0))
    first /= max(1.0, ratio) if asked.speed_bound == "maximum" else share + ratio * (1 - share)
    edge = -asked.lead + share * (asked.lead + asked.duration)
    return Pace(-asked.lead, (edge, asked.duration), (first, ratio * first))


def draw_forward(asked: MotionRequest, rng: np.random.Generator) -> Pace:
    pace = draw_pace(asked, rng)
    while min(pace.speeds) < 0:
        pace = draw_pace(asked, rng)
    return pace


def draw_pace(asked: MotionRequest, rng: np.random.Generator, steepest: float = 1.0) -> Pace:
    """A level's pace on a path at most `steepest` times as fast as the advance."""
    if not asked.level:
        return Pace(-asked.lead, (asked.duration,), (0.0,))
    speed = asked.alpha * rng.uniform(SLOWEST, 1.0) / steepest
    if asked.level == 1:
        return Pace(-asked.lead, (asked.duration,), (float(speed),))
    if asked.level == 2:
        swell = float(rng.uniform(*SWELL) * rng.choice([-1.0, 1.0]))
        if asked.speed_bound == "maximum":
            speed /= 1 + abs(swell)
        return Pace(-asked.lead, (asked.duration,), (float(speed),), swell)
    pieces = int(rng.integers(2, 4))
    shares = LEAST_SHARE + (1 - pieces * LEAST_SHARE) * rng.dirichlet(np.ones(pieces))
    edges = -asked.lead + (asked.lead + asked.duration) * np.cumsum(shares)
    factors = rng.uniform(-1.0, 1.0, pieces)
    while factors[-1] < LEAST_END or np.abs(np.diff(factors)).min() < LEAST_JUMP:
        factors = rng.uniform(-1.0, 1.0, pieces)
    scale = asked.alpha * rng.uniform(SLOWEST, 1.0) / steepest / np.abs(factors).max()
    last = tuple((factors * scale).tolist())
    return Pace(-asked.lead, (*edges[:-1].tolist(), asked.duration), last)

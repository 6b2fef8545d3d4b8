"""A motion that events stop, turn back, speed up or displace."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats

from .carried import Rider
from .contract import Features, TargetMotion
from .scenery import Prop

PUSHED = 0.3
"""Time constant (s) with which a push loses its speed."""


class Change(NamedTuple):
    """From `time` (s) on: the `rate` of the clock and a push with `x`, `y` m/s."""

    time: float
    rate: float
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True, eq=False)
class Changed:
    """The motion `base` with changes in order of time; features as drawn."""

    base: TargetMotion
    changes: tuple[Change, ...]

    @property
    def model(self) -> str:
        return self.base.model

    @property
    def level(self) -> int:
        return self.base.level

    @property
    def alpha(self) -> float:
        return self.base.alpha

    @property
    def duration(self) -> float:
        return self.base.duration

    @property
    def lead(self) -> float:
        return self.base.lead

    @property
    def others(self) -> Mapping[str, TargetMotion]:
        """What moves beside it; an event changes what is carried along."""
        others: Mapping[str, TargetMotion] = getattr(self.base, "others", {})
        return {n: Rider(self, m.at) if isinstance(m, Rider) else m for n, m in others.items()}

    def _clock(self, t: ArrayLike) -> tuple[Floats, Floats]:
        """The time (...,) of `base`, and its rate, at times t (...,)."""
        t = np.asarray(t, float)
        clock, rate = t, np.ones(t.shape)
        for change in self.changes:
            later = t >= change.time
            reached = self._reached(change)
            clock = np.where(later, reached + change.rate * (t - change.time), clock)
            rate = np.where(later, change.rate, rate)
        return clock, rate

    def _reached(self, change: Change) -> float:
        clock, since, rate = 0.0, 0.0, 1.0
        for earlier in self.changes:
            clock, since = clock + rate * (earlier.time - since), earlier.time
            if earlier is change:
                break
            rate = earlier.rate
        return clock

    def pose(self, t: ArrayLike) -> Floats:
        t = np.asarray(t, float)
        poses = np.array(self.base.pose(self._clock(t)[0]))
        for change in self.changes:
            gone = PUSHED * -np.expm1(-np.maximum(t - change.time, 0.0) / PUSHED)
            poses[..., 0] += change.x * gone
            poses[..., 1] += change.y * gone
        return poses

    def twist(self, t: ArrayLike) -> Floats:
        t = np.asarray(t, float)
        clock, rate = self._clock(t)
        twists = np.array(self.base.twist(clock)) * rate[..., None]
        for change in self.changes:
            left = np.exp(-np.maximum(t - change.time, 0.0) / PUSHED) * (t >= change.time)
            twists[..., 0] += change.x * left
            twists[..., 1] += change.y * left
        return twists

    def breakpoints(self) -> Floats:
        times = [change.time for change in self.changes if change.time < self.duration]
        return np.unique(np.concatenate([self.base.breakpoints(), times]))

    def features(self) -> Features:
        return self.base.features()

    def scenery(self) -> tuple[Prop, ...]:
        """That of the base, which stops and turns with it."""
        return tuple(
            replace(prop, pose=lambda t, prop=prop: prop.pose(self._clock(t)[0]))
            for prop in self.base.scenery()
        )

    def to_json(self) -> str:
        values: dict[str, Any] = json.loads(self.base.to_json())
        return json.dumps(values | {"changes": [list(c) for c in self.changes]}, allow_nan=False)


def changed(motion: TargetMotion, change: Change) -> Changed:
    """The motion with one more change, later than those that it has."""
    if isinstance(motion, Changed):
        return Changed(motion.base, (*motion.changes, change))
    return Changed(motion, (change,))


def changes_of(values: Any) -> tuple[Change, ...]:
    """The changes that `to_json` wrote. Raises ValueError."""
    rows = np.asarray(values, float)
    if rows.ndim != 2 or rows.shape[1] != 4 or not np.isfinite(rows).all():
        raise ValueError("this is not a target motion: its changes are no rows of four numbers")
    return tuple(Change(*row) for row in rows.tolist())

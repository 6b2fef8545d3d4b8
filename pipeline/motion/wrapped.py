"""Motions around another motion: what rides on a target, what events change, and company."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, compose, inverse

from .contract import Features, TargetMotion
from .scenery import Prop

CARRIED: Final = "carried"
"""In place of a model in `movers`: the body moves with the target, as one rigid thing."""

PUSHED = 0.3
"""Time constant (s) with which a push loses its speed."""


@dataclass(frozen=True, eq=False)
class Wrapped:
    """The motion `base`, where a subclass does not say otherwise."""

    base: TargetMotion

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

    def pose(self, t: ArrayLike) -> Floats:
        return self.base.pose(t)

    def twist(self, t: ArrayLike) -> Floats:
        return self.base.twist(t)

    def breakpoints(self) -> Floats:
        return self.base.breakpoints()

    def features(self) -> Features:
        return self.base.features()

    def scenery(self) -> tuple[Prop, ...]:
        return self.base.scenery()

    def to_json(self) -> str:
        return self.base.to_json()


@dataclass(frozen=True, eq=False)
class Rider(Wrapped):
    """A body at a fixed pose `at` (7,) relative to the target, whose motion is `base`."""

    at: Floats

    @property
    def model(self) -> str:
        return CARRIED

    def pose(self, t: ArrayLike) -> Floats:
        return compose(self.base.pose(t), self.at)

    def twist(self, t: ArrayLike) -> Floats:
        twist, arm = self.base.twist(t), self.pose(t)[..., :3] - self.base.pose(t)[..., :3]
        linear = twist[..., :3] + np.cross(twist[..., 3:], arm)
        return np.concatenate([linear, twist[..., 3:]], -1)

    def scenery(self) -> tuple[Prop, ...]:
        return ()

    def to_json(self) -> str:
        return json.dumps({"model": CARRIED, "at": np.asarray(self.at).tolist()}, allow_nan=False)


@dataclass(frozen=True, eq=False)
class Company(Wrapped):
    """The target's motion, and those of `others` by name."""

    others: Mapping[str, TargetMotion]

    def scenery(self) -> tuple[Prop, ...]:
        more = [
            replace(p, name=f"{name}_{p.name}")
            for name, motion in self.others.items()
            for p in motion.scenery()
        ]
        return (*self.base.scenery(), *more)

    def to_json(self) -> str:
        others = {name: json.loads(motion.to_json()) for name, motion in self.others.items()}
        return json.dumps(json.loads(self.base.to_json()) | {"others": others}, allow_nan=False)


class Change(NamedTuple):
    """From `time` (s) on: the `rate` of the clock and a push with `x`, `y` m/s."""

    time: float
    rate: float
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True, eq=False)
class Changed(Wrapped):
    """A motion that events stop, turn back, speed up or displace, in order of time; features are
    those drawn."""

    changes: tuple[Change, ...]

    @property
    def others(self) -> Mapping[str, TargetMotion]:
        """What moves beside it; an event changes what is carried along."""
        others = others_of(self.base)
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

    def scenery(self) -> tuple[Prop, ...]:
        clocks = ((p, lambda t, p=p: p.pose(self._clock(t)[0])) for p in self.base.scenery())
        return tuple(replace(prop, pose=pose) for prop, pose in clocks)

    def to_json(self) -> str:
        values: dict[str, Any] = json.loads(self.base.to_json())
        return json.dumps(values | {"changes": [list(c) for c in self.changes]}, allow_nan=False)


def changed(motion: TargetMotion, change: Change) -> Changed:
    if isinstance(motion, Changed):
        return Changed(motion.base, (*motion.changes, change))
    return Changed(motion, (change,))


def led_by(name: str, motion: TargetMotion) -> Company:
    """The motions of a target and of what moves beside it, with body `name` as the target and the
    target under that name."""
    others = dict(others_of(motion))
    leader = others[name]
    if isinstance(leader, Rider):
        back = inverse(leader.at)
        riders = {n: m.at for n, m in others.items() if isinstance(m, Rider)}
        others |= {n: Rider(leader, compose(back, at)) for n, at in riders.items()}
        return Company(leader, others | {name: Rider(leader, back)})
    return Company(leader, others | {name: motion})


def changes_of(values: Any) -> tuple[Change, ...]:
    """The changes that `to_json` wrote. Raises ValueError."""
    rows = np.asarray(values, float)
    if rows.ndim != 2 or rows.shape[1] != 4 or not np.isfinite(rows).all():
        raise ValueError("this is not a target motion: its changes are no rows of four numbers")
    return tuple(Change(*row) for row in rows.tolist())


def others_of(motion: object) -> Mapping[str, TargetMotion]:
    """What moves beside the target of a motion, by name."""
    return getattr(motion, "others", {})

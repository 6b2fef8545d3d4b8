"""The target flies, dropped or tossed, and is met above the table."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, pose

from ..closed_form import ClosedForm, ClosedFormModel, twists
from ..contract import MotionRequest, Streams
from ..pace import Pace, draw_pace
from ..scenery import Prop, flat, rod
from . import register

GRAVITY = 9.81
HEIGHT = (0.06, 0.12)  # m of free fall, or of free rise
FLING = 2.0  # acceleration of the tossing plate over that of gravity
STEEL, RUBBER = (0.55, 0.56, 0.60), (0.16, 0.17, 0.19)


@dataclass(frozen=True)
class Ballistic(ClosedForm):
    """Carried along `heading` (rad) at a `pace` until `flight` s before the meeting; then in
    flight: z(T) + w (t - T) - g (t - T)^2 / 2. At `floor` (m) it lies still."""

    heading: float
    pace: Pace
    flight: float
    floor: float
    top: float

    @property
    def release(self) -> float:
        """Time (s) from which it flies."""
        return self.duration - self.flight

    @property
    def sink(self) -> float:
        """Vertical velocity w (m/s) at the meeting."""
        return 0.0

    @abstractmethod
    def carried(self, t: Floats) -> tuple[Floats, Floats]:
        """Height over the end (...,) m and vertical velocity (...,) m/s before the release."""

    @property
    def landing(self) -> float:
        """Time (s) at which it comes down to the floor; infinite for one that stands."""
        if not self.flight:
            return np.inf
        fall = np.sqrt(self.sink**2 + 2 * GRAVITY * max(self.end[2] - self.floor, 0.0))
        return float(self.duration + (self.sink + fall) / GRAVITY)

    def _height(self, t: Floats) -> tuple[Floats, Floats]:
        late = t - self.duration
        before, rate = self.carried(t)
        flying = t >= self.release if self.flight else np.zeros(np.shape(t), bool)
        height = np.where(flying, self.sink * late - GRAVITY * late**2 / 2, before)
        return height, np.where(flying, self.sink - GRAVITY * late, rate)

    def place(self, t: Floats) -> Floats:
        t = np.minimum(t, self.landing)
        ahead = self.pace.advance(t) - self.pace.advance(np.array(self.duration))
        x, y = ahead * np.cos(self.heading), ahead * np.sin(self.heading)
        return self.carried_by(x, y, self._height(t)[0])

    def rates(self, t: Floats) -> Floats:
        along = self.pace.rate(t)
        x, y = along * np.cos(self.heading), along * np.sin(self.heading)
        return twists(x, y, self._height(t)[1]) * (t < self.landing)[..., None]

    def speed(self, t: ArrayLike) -> Floats:
        return np.asarray(np.linalg.norm(self.twist(t)[..., :2], axis=-1), float)

    def breakpoints(self) -> Floats:
        return np.array(self.pace.edges[:-1])

    def bearer(self, t: ArrayLike) -> Floats:
        """Pose (..., 7) of what carries it, which stops at the release."""
        poses = self.pose(np.minimum(np.asarray(t, float), self.release))
        poses[..., 3:] = pose()[3:]
        return poses


@dataclass(frozen=True)
class Drop(Ballistic):
    """A carrier lets go of it at rest in height: w = -g flight."""

    kind: ClassVar[str] = "drop"

    @property
    def sink(self) -> float:
        return -GRAVITY * self.flight

    def carried(self, t: Floats) -> tuple[Floats, Floats]:
        return np.full(np.shape(t), GRAVITY * self.flight**2 / 2), np.zeros(np.shape(t))

    def scenery(self) -> tuple[Prop, ...]:
        cup = rod((0, 0, self.top), (0, 0, self.top + 0.015), 0.012, RUBBER)
        stem = rod((0, 0, self.top + 0.015), (0, 0, self.top + 0.20), 0.006, STEEL)
        return (Prop("carrier", (cup, stem), self.bearer),)


@dataclass(frozen=True)
class Toss(Ballistic):
    """A plate accelerates it by 2 g; it meets at the top of its flight."""

    kind: ClassVar[str] = "toss"

    def carried(self, t: Floats) -> tuple[Floats, Floats]:
        lowest = -GRAVITY * self.flight**2 / 2 * (1 + 1 / FLING)
        flung = np.clip(t - (self.release - self.flight / FLING), 0.0, self.flight / FLING)
        return lowest + FLING * GRAVITY * flung**2 / 2, FLING * GRAVITY * flung

    def scenery(self) -> tuple[Prop, ...]:
        plate = flat("cylinder", (0.03,), -0.006, RUBBER)
        stem = rod((0, 0, -0.006), (0, 0, -0.12), 0.008, STEEL)
        return (Prop("launcher", (plate, stem), self.bearer),)


class BallisticModel[M: Ballistic](ClosedFormModel[M]):
    """One height that keeps the plate over the floor, then headings in turn."""

    def shape(self, asked: MotionRequest, streams: Streams) -> dict[str, Any]:
        rng, z = streams.shape, float(np.asarray(asked.end_pose, float)[2])
        height = float(rng.uniform(*HEIGHT))
        if self._motion is Toss:
            height = min(height, (z - asked.floor) / (1 + 1 / FLING))
        flight = float(np.sqrt(2 * height / GRAVITY)) if asked.level else 0.0
        pace = _slowed(draw_pace(replace(asked, duration=asked.duration - flight), rng), flight)
        return {"pace": pace, "flight": flight, "floor": asked.floor, "top": asked.height}


def _slowed(pace: Pace, flight: float) -> Pace:
    """The pace with its mean speed kept over a further `flight` (s)."""
    spans, last = np.diff([pace.start, *pace.edges]), float(pace.rate(np.array(pace.edges[-1])))
    way, share = float(np.abs(pace.speeds) @ spans), 1.0
    if way:
        slower = (way / spans.sum()) * (spans.sum() + flight) / (way + abs(last) * flight)
        share = min(1.0, slower)
    return replace(pace, speeds=tuple(speed * share for speed in pace.speeds))


register(BallisticModel(Drop))
register(BallisticModel(Toss))

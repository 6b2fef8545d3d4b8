"""The target hangs from a visible hook and swings."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, pose

from ..closed_form import ClosedForm, ClosedFormModel, turned_about, turns
from ..contract import MotionRequest, Streams, described
from ..scenery import Piece, Prop, rod, standing
from . import register

GRAVITY = 9.81
LENGTH = (0.25, 0.40)  # m from the pivot to the body's origin
DECAY = (0.10, 0.35)  # 1/s
KNOCK = (0.3, 0.6)  # amplitude before a knock as a share of that after it
STEEL, CORD = (0.55, 0.56, 0.60), (0.85, 0.83, 0.78)


@dataclass(frozen=True)
class Pendulum(ClosedForm):
    """The angle from the vertical is A(t) sin(w (t - T)), w = sqrt(g / length), along `heading`
    (rad). A(t) = `amplitude` exp(`decay` (T - t)) (rad), before each of `knocks` times `share`. The
    pivot is `length` m above the end; the body's top `top` m above its origin."""

    kind: ClassVar[str] = "pendulum"
    heading: float
    length: float
    top: float
    amplitude: float
    decay: float = 0.0
    knocks: tuple[float, ...] = ()
    share: float = 1.0

    @property
    def _rate(self) -> float:
        return float(np.sqrt(GRAVITY / self.length))

    @property
    def _pivot(self) -> Floats:
        return np.array(self.end[:3]) + np.array([0.0, 0.0, self.length])

    @property
    def _axis(self) -> Floats:
        return np.array([np.sin(self.heading), -np.cos(self.heading), 0.0])

    def _amplitude(self, t: Floats) -> Floats:
        before = np.sum(np.asarray(t)[..., None] < np.array(self.knocks), -1)
        return np.asarray(
            self.amplitude * self.share**before * np.exp(self.decay * (self.duration - t)), float
        )

    def _angle(self, t: Floats) -> Floats:
        return np.asarray(self._amplitude(t) * np.sin(self._rate * (t - self.duration)), float)

    def place(self, t: Floats) -> Floats:
        return turned_about(self.end, self._pivot, turns(self._axis, self._angle(t)))

    def rates(self, t: Floats) -> Floats:
        swing = self._rate * (t - self.duration)
        rate = self._amplitude(t) * (self._rate * np.cos(swing) - self.decay * np.sin(swing))
        spin = rate[..., None] * self._axis
        line = np.asarray(np.cross(spin, self.place(t)[..., :3] - self._pivot), float)
        return np.concatenate([line, spin], -1)

    def breakpoints(self) -> Floats:
        return np.array(self.knocks)

    def scenery(self) -> tuple[Prop, ...]:
        up = self.length - self.top
        ring = Piece("box", (0.031, 0.003, 0.003), pose((0, 0, -up)), STEEL)
        beam = Piece("box", (0.05, 0.008, 0.006), pose((0, 0, 0.006)), STEEL)
        cord = rod((0, 0, 0), (0, 0, -up), 0.0015, CORD)
        hook = Prop("hook", (beam,), standing(pose(self._pivot)))
        return (hook, Prop("cord", (cord, ring), self._hung))

    def _hung(self, t: ArrayLike) -> Floats:
        angle = self._angle(np.maximum(np.asarray(t, float), -self.lead))
        return turned_about(pose(self._pivot), self._pivot, turns(self._axis, angle))


class PendulumModel(ClosedFormModel[Pendulum]):
    """The greatest speed is alpha, at level 2 and 3 at the strongest swing."""

    levels = described(
        "a swing that keeps its width", "a swing that dies away", "a swing that is knocked"
    )

    def shape(self, asked: MotionRequest, streams: Streams) -> dict[str, Any]:
        rng = streams.shape
        length, decay, share = (float(rng.uniform(*r)) for r in (LENGTH, DECAY, KNOCK))
        rate = np.sqrt(GRAVITY / length)
        half_swings = int((asked.duration + asked.lead) * rate / np.pi)
        knock = asked.duration - np.pi / rate * int(rng.integers(1, max(half_swings, 1) + 1))
        first = decay * (asked.duration + asked.lead) if asked.level == 2 else 0.0
        amplitude = 0.0
        if asked.level:
            amplitude = asked.alpha * rng.uniform(0.6, 0.95) / (rate * length) * np.exp(-first)
        shape = {"length": length, "top": asked.height, "amplitude": float(amplitude)}
        match asked.level:
            case 2:
                return shape | {"decay": decay}
            case 3:
                return shape | {"knocks": (float(knock),), "share": share}
        return shape


register(PendulumModel(Pendulum))

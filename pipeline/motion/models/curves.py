"""The target moves on a circle, or goes straight on and swings to either side."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pipeline.poses import Floats

from ..closed_form import Along, ClosedFormModel, ahead_of, common, headings, twists
from ..contract import MotionRequest, Streams
from ..pace import draw_pace
from . import register

RADIUS = (0.04, 0.10)  # m
AMPLITUDE, WAVELENGTH = (0.015, 0.04), (0.10, 0.20)  # m


@dataclass(frozen=True)
class Circle(Along):
    """A circle through the end, its centre `inward` (rad); `sense` +1 is counterclockwise."""

    kind: ClassVar[str] = "circle"
    radius: float
    inward: float
    sense: int

    def _angle(self, s: Floats) -> Floats:
        """Direction (rad) from the centre to the body at advances s."""
        return self.inward + np.pi + self.sense * np.asarray(s) / self.radius

    def at(self, s: Floats) -> Floats:
        r, angle, start = self.radius, self._angle(s), self._angle(np.array(0.0))
        return self.carried_by(
            r * (np.cos(angle) - np.cos(start)), r * (np.sin(angle) - np.sin(start))
        )

    def slope(self, s: Floats) -> Floats:
        angle = self._angle(s)
        return twists(-self.sense * np.sin(angle), self.sense * np.cos(angle))


class CircleModel(ClosedFormModel[Circle]):
    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Circle]:
        pace, radius = draw_pace(asked, streams.shape), float(streams.shape.uniform(*RADIUS))
        for inward in headings(streams):
            sense = int(streams.direction.choice([-1, 1]))
            yield Circle(**common(asked), pace=pace, radius=radius, inward=inward, sense=sense)


register(CircleModel(Circle))


@dataclass(frozen=True)
class Sinusoid(Along):
    """By s along `heading` (rad), aside by amplitude (sin(2 pi s / wavelength + phase) -
    sin(phase))."""

    kind: ClassVar[str] = "sinusoid"
    heading: float
    amplitude: float
    wavelength: float
    phase: float

    def at(self, s: Floats) -> Floats:
        s = np.asarray(s)
        wave = np.sin(2 * np.pi * s / self.wavelength + self.phase) - np.sin(self.phase)
        return self.carried_by(*ahead_of(self.heading, s, self.amplitude * wave))

    def slope(self, s: Floats) -> Floats:
        wave = 2 * np.pi / self.wavelength
        aside = self.amplitude * wave * np.cos(wave * np.asarray(s) + self.phase)
        return twists(*ahead_of(self.heading, np.ones(np.shape(s)), aside))


class SinusoidModel(ClosedFormModel[Sinusoid]):
    def shape(self, asked: MotionRequest, streams: Streams) -> dict[str, Any]:
        ranges = {"amplitude": AMPLITUDE, "wavelength": WAVELENGTH, "phase": (-np.pi, np.pi)}
        wave = {name: float(streams.shape.uniform(*bounds)) for name, bounds in ranges.items()}
        slope = 2 * np.pi * wave["amplitude"] / wave["wavelength"]
        return wave | {"pace": draw_pace(asked, streams.shape, float(np.hypot(1.0, slope)))}


register(SinusoidModel(Sinusoid))

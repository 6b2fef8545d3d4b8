"""The target weaves: it goes straight on and swings to either side."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pipeline.motion.closed_form import Along, ClosedFormModel, common, headings
from pipeline.motion.contract import Array, MotionRequest, Streams
from pipeline.motion.models import register
from pipeline.motion.pace import draw_pace

AMPLITUDE, WAVELENGTH = (0.015, 0.04), (0.10, 0.20)  # m


@dataclass(frozen=True)
class Sinusoid(Along):
    """By the advance s along `heading` (rad), and aside by amplitude (sin(2 pi s / wavelength +
    phase) - sin(phase))."""

    kind: ClassVar[str] = "sinusoid"
    heading: float
    amplitude: float
    wavelength: float
    phase: float

    def at(self, s: Array) -> Array:
        poses, s = np.broadcast_to(np.array(self.end), (*np.shape(s), 7)).copy(), np.asarray(s)
        aside = self.amplitude * (
            np.sin(2 * np.pi * s / self.wavelength + self.phase) - np.sin(self.phase)
        )
        poses[..., :2] += self._world(s, aside)
        return poses

    def slope(self, s: Array) -> Array:
        wave, twists = 2 * np.pi / self.wavelength, np.zeros((*np.shape(s), 6))
        twists[..., :2] = self._world(
            np.ones(np.shape(s)), self.amplitude * wave * np.cos(wave * np.asarray(s) + self.phase)
        )
        return twists

    def _world(self, ahead: Array, aside: Array) -> Array:
        c, s = np.cos(self.heading), np.sin(self.heading)
        return np.stack([c * ahead - s * aside, s * ahead + c * aside], -1)


class SinusoidModel(ClosedFormModel[Sinusoid]):
    """One wave; its direction is the attempt's."""

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Sinusoid]:
        rng = streams.shape
        amplitude, wavelength, phase = (
            float(rng.uniform(*r)) for r in (AMPLITUDE, WAVELENGTH, (-np.pi, np.pi))
        )
        steepest = float(np.hypot(1.0, 2 * np.pi * amplitude / wavelength))
        pace = draw_pace(asked, rng, steepest)
        for heading in headings(streams):
            shape: dict[str, Any] = {
                "amplitude": amplitude,
                "wavelength": wavelength,
                "phase": phase,
            }
            yield Sinusoid(**common(asked), pace=pace, heading=heading, **shape)


register(SinusoidModel(Sinusoid))

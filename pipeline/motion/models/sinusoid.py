"""The target weaves: it goes straight on and swings to either side."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pipeline.motion.closed_form import Along, ClosedFormModel, common, headings, twists
from pipeline.motion.contract import MotionRequest, Streams
from pipeline.motion.pace import draw_pace
from pipeline.poses import Floats

from . import register

AMPLITUDE, WAVELENGTH = (0.015, 0.04), (0.10, 0.20)  # m


@dataclass(frozen=True)
class Sinusoid(Along):
    """By s along `heading` (rad), aside by amplitude (sin(2 pi s / wavelength + phase) -
    sin(phase)).
    """

    kind: ClassVar[str] = "sinusoid"
    heading: float
    amplitude: float
    wavelength: float
    phase: float

    def at(self, s: Floats) -> Floats:
        s = np.asarray(s)
        aside = self.amplitude * (
            np.sin(2 * np.pi * s / self.wavelength + self.phase) - np.sin(self.phase)
        )
        return self.carried_by(*self._world(s, aside))

    def slope(self, s: Floats) -> Floats:
        wave = 2 * np.pi / self.wavelength
        aside = self.amplitude * wave * np.cos(wave * np.asarray(s) + self.phase)
        return twists(*self._world(np.ones(np.shape(s)), aside))

    def _world(self, ahead: Floats, aside: Floats) -> tuple[Floats, Floats]:
        c, s = np.cos(self.heading), np.sin(self.heading)
        return c * ahead - s * aside, s * ahead + c * aside


class SinusoidModel(ClosedFormModel[Sinusoid]):
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

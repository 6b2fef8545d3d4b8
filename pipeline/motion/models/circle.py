"""The target moves on a circle and keeps its orientation."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.motion.closed_form import Along, ClosedFormModel, common, headings, twists
from pipeline.motion.contract import MotionRequest, Streams
from pipeline.motion.pace import draw_pace
from pipeline.poses import Floats

from . import register

RADIUS = (0.04, 0.10)  # m


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

"""A round target rolls straight on without slipping."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.motion.closed_form import Along, ClosedFormModel, common, headings, turns
from pipeline.motion.contract import MotionRequest, Streams
from pipeline.motion.pace import draw_pace
from pipeline.poses import Floats, quat_multiply, quat_rotate

from . import register


@dataclass(frozen=True)
class Rolling(Along):
    """A roll without slipping along `heading` (rad), with the centre `radius` m above the end
    pose's origin. Speeds are the centre's.
    """

    kind: ClassVar[str] = "rolling"
    heading: float
    radius: float

    @property
    def _forward(self) -> Floats:
        return np.array([np.cos(self.heading), np.sin(self.heading), 0.0])

    @property
    def _axis(self) -> Floats:
        return np.array([-np.sin(self.heading), np.cos(self.heading), 0.0])

    def centre(self, s: Floats) -> Floats:
        """World position (..., 3) of the body's centre at advances s (...,)."""
        return (
            np.array(self.end[:3])
            + [0.0, 0.0, self.radius]
            + np.asarray(s)[..., None] * self._forward
        )

    def _turn(self, s: Floats) -> Floats:
        """The turn (..., 4) from the end pose at advances s."""
        return turns(self._axis, s / self.radius)

    def _leg(self, s: Floats) -> tuple[Floats, Floats]:
        """Direction and axis (..., 3) of the roll at advances s (...,)."""
        return self._forward, np.broadcast_to(self._axis, (*np.shape(s), 3))

    def at(self, s: Floats) -> Floats:
        turn = self._turn(np.asarray(s))
        place = self.centre(s) - quat_rotate(turn, np.array([0.0, 0.0, self.radius]))
        return np.concatenate([place, quat_multiply(turn, np.array(self.end[3:]))], -1)

    def slope(self, s: Floats) -> Floats:
        forward, axis = self._leg(np.asarray(s))
        spin = axis / self.radius
        arm = self.at(s)[..., :3] - self.centre(s)
        return np.concatenate([forward + np.cross(spin, arm), spin], -1)

    def speed(self, t: ArrayLike) -> Floats:
        return np.abs(self.pace.rate(np.maximum(t, -self.lead))) * (np.asarray(t) >= -self.lead)


class RollingModel(ClosedFormModel[Rolling]):
    """The target must be a ball or a lying cylinder."""

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Rolling]:
        pace = draw_pace(asked, streams.shape)
        for heading in headings(streams):
            yield Rolling(**common(asked), pace=pace, heading=heading, radius=asked.height / 2)


register(RollingModel(Rolling))

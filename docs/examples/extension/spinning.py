"""A model of motions: the target slides straight on and spins about its vertical axis."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.motion.closed_form import (
    Along,
    ClosedFormModel,
    common,
    headings,
    turned_about,
    turns,
)
from pipeline.motion.contract import Array, MotionRequest, Streams
from pipeline.motion.models import register
from pipeline.motion.pace import draw_pace

UP = np.array([0.0, 0.0, 1.0])
TURN = (5.0, 15.0)  # rad a metre


@dataclass(frozen=True)
class Spinning(Along):
    """At the advance s (m; 0 at the end) the body is s further along `heading` (rad), turned by
    `turn` s rad about the vertical."""

    kind: ClassVar[str] = "spinning"
    heading: float
    turn: float

    @property
    def _forward(self) -> Array:
        return np.array([np.cos(self.heading), np.sin(self.heading), 0.0])

    def at(self, s: Array) -> Array:
        poses = turned_about(self.end, self.end[:3], turns(UP, self.turn * np.asarray(s)))
        poses[..., :3] += np.asarray(s)[..., None] * self._forward
        return poses

    def slope(self, s: Array) -> Array:
        return np.broadcast_to(np.concatenate([self._forward, self.turn * UP]), (*np.shape(s), 6))


class SpinningModel(ClosedFormModel[Spinning]):
    """The slot decides pace and spin, the attempt the direction."""

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Spinning]:
        pace, turn = draw_pace(asked, streams.shape), float(streams.shape.uniform(*TURN))
        for heading in headings(streams):
            yield Spinning(**common(asked), pace=pace, heading=heading, turn=turn)


register(SpinningModel(Spinning))

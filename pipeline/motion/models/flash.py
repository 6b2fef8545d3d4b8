"""The target rides on a plate that lights up for a moment, green or red."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.motion.closed_form import ClosedFormModel, common, headings
from pipeline.motion.contract import MotionRequest, Streams
from pipeline.motion.pace import draw_pace
from pipeline.motion.scenery import AWAY, SHEET, Prop, flat
from pipeline.poses import Floats, pose

from . import register
from .conveyor import MARGIN, Conveyor

ON, LASTS = (0.3, 0.6), 0.6  # s from the start, and for which the light is on
DARK, GREEN, RED = (0.20, 0.21, 0.23), (0.20, 0.95, 0.30), (0.98, 0.15, 0.12)


@dataclass(frozen=True)
class Flash(Conveyor):
    """As `conveyor`, on a plate of `width` m that is lit from `on` s for LASTS s."""

    kind: ClassVar[str] = "flash"
    colour: ClassVar[tuple[float, float, float]] = GREEN
    on: float

    def scenery(self) -> tuple[Prop, ...]:
        plate = flat("cylinder", (self.width / 2,), SHEET, DARK)
        light = flat("cylinder", (self.width / 2 - 0.004,), SHEET + 0.001, self.colour)
        return (Prop("plate", (plate,), self._under), Prop("light", (light,), self._light))

    def _under(self, t: ArrayLike) -> Floats:
        poses = self.pose(t)
        poses[..., 3:] = pose()[3:]
        return poses

    def _light(self, t: ArrayLike) -> Floats:
        t = np.asarray(t, float)
        lit = (t >= self.on) & (t < self.on + LASTS)
        return np.where(lit[..., None], self._under(t), AWAY)


@dataclass(frozen=True)
class RedFlash(Flash):
    """As `flash`, in red."""

    kind: ClassVar[str] = "flash_red"
    colour: ClassVar[tuple[float, float, float]] = RED


class FlashModel[F: Flash](ClosedFormModel[F]):
    """Either colour: `flashes` is the class of the motion."""

    def __init__(self, flashes: type[F]) -> None:
        super().__init__(flashes)
        self._flashes = flashes

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[F]:
        pace, on = draw_pace(asked, streams.shape), float(streams.shape.uniform(*ON))
        width = 2 * (asked.radius + MARGIN)
        for heading in headings(streams):
            yield self._flashes(**common(asked), pace=pace, heading=heading, width=width, on=on)


register(FlashModel(Flash))
register(FlashModel(RedFlash))

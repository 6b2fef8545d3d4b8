"""The target rides on a plate that lights up for a moment: green under the target, red under what
moves beside it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.motion.closed_form import ClosedFormModel, common, headings
from pipeline.motion.contract import MotionRequest, Streams
from pipeline.motion.models import register
from pipeline.motion.models.conveyor import MARGIN, Conveyor
from pipeline.motion.pace import draw_pace
from pipeline.motion.scenery import AWAY, SHEET, Prop, flat
from pipeline.poses import Floats, pose

ON, LASTS = (0.3, 0.6), 0.6  # s from the start, and for which the light is on
DARK, GREEN, RED = (0.20, 0.21, 0.23), (0.20, 0.95, 0.30), (0.98, 0.15, 0.12)


@dataclass(frozen=True)
class Flash(Conveyor):
    """Straight on like `conveyor`, on a plate of `width` m that is lit from `on` s for LASTS s:
    green if it is `right`, else red."""

    kind: ClassVar[str] = "flash"
    on: float
    right: bool

    def scenery(self) -> tuple[Prop, ...]:
        plate = flat("cylinder", (self.width / 2,), SHEET, DARK)
        light = flat("cylinder", (self.width / 2 - 0.004,), SHEET + 0.001, self._colour)
        return (Prop("plate", (plate,), self._under), Prop("light", (light,), self._light))

    @property
    def _colour(self) -> tuple[float, float, float]:
        return GREEN if self.right else RED

    def _under(self, t: ArrayLike) -> Floats:
        poses = self.pose(t)
        poses[..., 3:] = pose()[3:]
        return poses

    def _light(self, t: ArrayLike) -> Floats:
        t = np.asarray(t, float)
        lit = (t >= self.on) & (t < self.on + LASTS)
        return np.where(lit[..., None], self._under(t), AWAY)


class FlashModel(ClosedFormModel[Flash]):
    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Flash]:
        pace, on = draw_pace(asked, streams.shape), float(streams.shape.uniform(*ON))
        if isinstance(asked.target, Flash):
            on = asked.target.on
        for heading in headings(streams):
            yield Flash(
                **common(asked),
                pace=pace,
                heading=heading,
                width=2 * (asked.radius + MARGIN),
                on=on,
                right=asked.target is None,
            )


register(FlashModel(Flash))

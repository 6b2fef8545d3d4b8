"""A ball rolls under the target, which then changes places with what looks the same."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.motion.closed_form import ClosedFormModel
from pipeline.motion.contract import MotionRequest, Streams
from pipeline.motion.models import register
from pipeline.motion.models.turntable import Turntable, TurntableModel
from pipeline.motion.scenery import SHEET, Piece, Prop
from pipeline.poses import Floats, pose

COVERED, SOONEST = (0.8, 1.2), 0.4  # s at which the ball is under it, and at most (share)
BALL, RED = 0.011, (0.85, 0.10, 0.08)


@dataclass(frozen=True)
class Shuffle(Turntable):
    """As `turntable`. A ball leaves the middle of the disc at the start, and is under the target
    from `covered` s on."""

    kind: ClassVar[str] = "shuffle"
    covered: float

    def scenery(self) -> tuple[Prop, ...]:
        ball = Piece("sphere", (BALL,), pose((0, 0, SHEET + BALL)), RED)
        return (*super().scenery(), Prop("ball", (ball,), self._ball))

    def _ball(self, t: ArrayLike) -> Floats:
        t = np.asarray(t, float)
        share = np.clip((t + self.lead) / (self.covered + self.lead), 0.0, 1.0)[..., None]
        middle = np.array([*self.centre, self.end[2]])
        at = np.broadcast_to(pose(middle), (*t.shape, 7)).copy()
        at[..., :3] += share * share * (3 - 2 * share) * (self.pose(t)[..., :3] - middle)
        return at


class ShuffleModel(ClosedFormModel[Shuffle]):
    """Turns as `turntable` draws them, about the middle of what is carried along."""

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Shuffle]:
        covered = float(min(streams.shape.uniform(*COVERED), SOONEST * asked.duration))
        for turn in TurntableModel(Turntable).candidates(asked, streams):
            numbers = {field.name: getattr(turn, field.name) for field in fields(turn)}
            yield Shuffle(**numbers, covered=covered)


register(ShuffleModel(Shuffle))

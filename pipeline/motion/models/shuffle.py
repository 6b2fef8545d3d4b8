"""A ball rolls under the target, which then changes places with a body that looks the same."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.motion.closed_form import ClosedFormModel, common, headings
from pipeline.motion.contract import MotionRequest, Streams
from pipeline.motion.models import register
from pipeline.motion.models.circle import Circle
from pipeline.motion.pace import draw_forward
from pipeline.motion.scenery import Piece, Prop
from pipeline.poses import Floats, pose

RADIUS = (0.07, 0.10)  # m, of a target alone
COVERED, SOONEST = (0.8, 1.2), 0.4  # s at which the ball is under it, and at most (share)
BALL, RED = 0.011, (0.85, 0.10, 0.08)
PACES = 4  # that are tried


@dataclass(frozen=True)
class Shuffle(Circle):
    """The circle whose centre is midway between the target and the other body, which is opposite
    all the time. A ball leaves the centre at the start and is under the target from `covered` s on;
    None for the other body."""

    kind: ClassVar[str] = "shuffle"
    covered: float | None

    def scenery(self) -> tuple[Prop, ...]:
        ball = Piece("sphere", (BALL,), pose((0, 0, BALL)), RED)
        return () if self.covered is None else (Prop("ball", (ball,), self._ball),)

    def _ball(self, t: ArrayLike) -> Floats:
        t = np.asarray(t, float)
        assert self.covered is not None
        share = np.clip((t + self.lead) / (self.covered + self.lead), 0.0, 1.0)[..., None]
        centre = np.array(self.end[:3])
        centre[:2] += self.radius * np.array([np.cos(self.inward), np.sin(self.inward)])
        at = np.broadcast_to(pose(centre), (*t.shape, 7)).copy()
        at[..., :3] += share * share * (3 - 2 * share) * (self.pose(t)[..., :3] - centre)
        return at


class ShuffleModel(ClosedFormModel[Shuffle]):
    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Shuffle]:
        end = common(asked)["end"]
        if isinstance(asked.target, Shuffle):
            yield replace(
                asked.target, end=end, inward=asked.target.inward + np.pi, covered=None
            )
            return
        for _ in range(PACES):
            pace, radius = draw_forward(asked, streams.shape), float(streams.shape.uniform(*RADIUS))
            covered = float(min(streams.shape.uniform(*COVERED), SOONEST * asked.duration))
            towards = headings(streams)
            if asked.others:
                x, y = (np.asarray(asked.others[0])[:2] - np.array(end[:2])).tolist()
                radius, towards = float(np.hypot(x, y)) / 2, [float(np.arctan2(y, x))] * 2
            first = int(streams.direction.choice([-1, 1]))
            for k, inward in enumerate(towards):
                yield Shuffle(
                    **common(asked),
                    pace=pace,
                    radius=radius,
                    inward=inward,
                    sense=first if k % 2 else -first,
                    covered=covered,
                )


register(ShuffleModel(Shuffle))

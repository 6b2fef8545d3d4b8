"""The target turns on a visible disc; a ball may roll under it."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, pose, quat_about

from ..closed_form import Along, ClosedFormModel, common, headings, turned_about, turns, twists
from ..contract import MotionRequest, Streams
from ..pace import draw_pace
from ..scenery import SHEET, Piece, Prop, flat
from . import register

SLATE, INLAY, HUB = (0.30, 0.36, 0.42), (0.86, 0.86, 0.84), (0.75, 0.75, 0.78)
RADIUS = (0.05, 0.11)  # m from the axis to the target
RIM = 0.02  # m of disc outside of the target
UP = np.array([0.0, 0.0, 1.0])
COVERED, SOONEST = (0.8, 1.2), 0.4  # s at which the ball is under it, and at most (share)
BALL, RED = 0.011, (0.85, 0.10, 0.08)


@dataclass(frozen=True)
class Turntable(Along):
    """A turn about the vertical axis through `centre` (x, y; m); `sense` +1 is counterclockwise."""

    kind: ClassVar[str] = "turntable"
    centre: tuple[float, float]
    sense: int
    disc: float

    @property
    def radius(self) -> float:
        """Distance (m) of the body's origin from the axis."""
        return float(np.hypot(self.end[0] - self.centre[0], self.end[1] - self.centre[1]))

    @property
    def _pivot(self) -> Floats:
        return np.array([*self.centre, self.end[2]])

    def _turn(self, s: Floats) -> Floats:
        return turns(UP, self.sense * np.asarray(s) / self.radius)

    def at(self, s: Floats) -> Floats:
        return turned_about(self.end, self._pivot, self._turn(s))

    def slope(self, s: Floats) -> Floats:
        rate = self.sense / self.radius
        from_axis = self.at(s)[..., :3] - self._pivot
        return twists(-rate * from_axis[..., 1], rate * from_axis[..., 0], spin=rate)

    def scenery(self) -> tuple[Prop, ...]:
        size = (0.45 * self.disc, 0.004, SHEET / 2 + 0.0004)
        thirds = (0.0, np.pi / 3, 2 * np.pi / 3)
        places = (pose((0, 0, SHEET / 2), quat_about(UP, angle)) for angle in thirds)
        spokes = [Piece("box", size, place, INLAY) for place in places]
        plate = flat("cylinder", (self.disc,), SHEET, SLATE)
        pieces = (plate, *spokes, flat("cylinder", (0.012,), 0.004, HUB))
        return (Prop("disc", pieces, self._turned),)

    def _turned(self, t: ArrayLike) -> Floats:
        advance = self.pace.advance(np.maximum(np.asarray(t, float), -self.lead))
        return turned_about(pose(self._pivot), self._pivot, self._turn(advance))


class TurntableModel(ClosedFormModel[Turntable]):
    """The axis is tried in one direction after another, or amid the company."""

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Turntable]:
        pace, radius = draw_pace(asked, streams.shape), streams.shape.uniform(*RADIUS)
        bodies = np.array([(*asked.end[:2], asked.radius), *asked.company])
        x, y = asked.end[:2].tolist()
        for angle in headings(streams):
            centre = (float(x + radius * np.cos(angle)), float(y + radius * np.sin(angle)))
            disc = radius + asked.radius
            if asked.company:
                centre = (float(bodies[:, 0].mean()), float(bodies[:, 1].mean()))
                disc = (np.hypot(*(bodies[:, :2] - centre).T) + bodies[:, 2]).max()
            sense = int(streams.direction.choice([-1, 1]))
            yield Turntable(
                **common(asked), pace=pace, centre=centre, sense=sense, disc=float(disc + RIM)
            )


register(TurntableModel(Turntable))


@dataclass(frozen=True)
class Shuffle(Turntable):
    """As `turntable`; a ball rolls under the target and is there from `covered` s on."""

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
    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Shuffle]:
        covered = float(min(streams.shape.uniform(*COVERED), SOONEST * asked.duration))
        for turn in TurntableModel(Turntable).candidates(asked, streams):
            numbers = {field.name: getattr(turn, field.name) for field in fields(turn)}
            yield Shuffle(**numbers, covered=covered)


register(ShuffleModel(Shuffle))

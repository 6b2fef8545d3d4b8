"""The target rides straight on a visible belt, or on a plate that lights up green or red."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, pose, yawed

from ..closed_form import Along, ClosedFormModel, common, headings, ways
from ..contract import MotionRequest, Streams
from ..pace import draw_pace
from ..scenery import AWAY, SHEET, Piece, Prop, flat, standing
from . import register

RUBBER, RAIL, SLAT = (0.13, 0.14, 0.15), (0.62, 0.64, 0.66), (0.85, 0.72, 0.20)
MARGIN = 0.025  # m of belt on either side of what rides on it
LANE = 0.045  # m from the target's line, at most, of what the belt carries besides
GAP = 0.08  # m between slats
AFTER = 1.0  # s after the meeting for which there are slats
SUNK = 0.005  # m
RUNOUT = 0.14  # m of belt beyond both ends of the path


@dataclass(frozen=True)
class Conveyor(Along):
    """The end pose moved back along `heading` (rad). The belt goes `runout` m beyond the path."""

    kind: ClassVar[str] = "conveyor"
    heading: float
    width: float
    runout: float = field(default=RUNOUT, kw_only=True)

    def at(self, s: Floats) -> Floats:
        x, y, _ = ways(self.heading)[0]
        return self.carried_by(np.asarray(s) * x, np.asarray(s) * y)

    def slope(self, s: Floats) -> Floats:
        twist = np.concatenate([ways(self.heading)[0], np.zeros(3)])
        return np.broadcast_to(twist, (*np.shape(s), 6))

    def to_json(self) -> str:
        values: dict[str, Any] = json.loads(super().to_json())
        if self.runout == RUNOUT:
            del values["runout"]
        return json.dumps(values, allow_nan=False)

    def scenery(self) -> tuple[Prop, ...]:
        ridden = self.pace.advance(np.linspace(-self.lead, self.duration, 200))
        first, last = float(ridden.min()), float(ridden.max())
        ends = (first - self.runout, last + self.runout)
        half, side = (ends[1] - ends[0]) / 2, self.width / 2 + 0.004
        way = sum(ends) / 2 * ways(self.heading)[0]
        middle = yawed(np.array(self.end[:3]) + way, self.heading)
        band = flat("box", (half, self.width / 2), SHEET, RUBBER)
        rails = [
            Piece("box", (half, 0.004, 0.002), pose((0, y, 0.002)), RAIL) for y in (side, -side)
        ]
        slat = flat("box", (0.003, self.width / 2), SHEET + 0.0008, SLAT)
        last = max(last, float(self.pace.advance(np.array(self.duration + AFTER))))
        places = np.arange(ends[0] - last, ends[1] - first, GAP).tolist()
        paths = (partial(self._slat, ends, place) for place in places)
        moving = [Prop(f"slat_{k}", (slat,), path) for k, path in enumerate(paths, 1)]
        return (Prop("belt", (band, *rails), standing(middle)), *moving)

    def _slat(self, ends: tuple[float, float], place: float, t: ArrayLike) -> Floats:
        """Poses of the slat; beyond the belt it runs below the table top."""
        along = place + self.pace.advance(np.maximum(np.asarray(t, float), -self.lead))
        poses = self.at(along)
        poses[..., 3:] = yawed((0, 0, 0), self.heading)[3:]
        poses[..., 2] -= SUNK * ((along < ends[0]) | (along > ends[1]))
        return poses


class ConveyorModel(ClosedFormModel[Conveyor]):
    """Directions along the table's length come first."""

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Conveyor]:
        pace = draw_pace(asked, streams.shape)
        bodies = np.array([(*asked.end[:2], asked.radius), *asked.company])
        away = bodies[:, :2] - bodies[0, :2]
        for heading in sorted(headings(streams), key=lambda a: abs(np.sin(a)) > 0.4):
            aside = np.abs(away @ (-np.sin(heading), np.cos(heading)))
            if aside.max() <= LANE:
                yield Conveyor(
                    **common(asked),
                    pace=pace,
                    heading=heading,
                    width=2 * float((aside + bodies[:, 2]).max() + MARGIN),
                    runout=float(RUNOUT + np.hypot(*away.T).max()),
                )


register(ConveyorModel(Conveyor))


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
    kind: ClassVar[str] = "flash_red"
    colour: ClassVar[tuple[float, float, float]] = RED


class FlashModel[F: Flash](ClosedFormModel[F]):
    def shape(self, asked: MotionRequest, streams: Streams) -> dict[str, Any]:
        pace, on = draw_pace(asked, streams.shape), float(streams.shape.uniform(*ON))
        return {"pace": pace, "on": on, "width": 2 * (asked.radius + MARGIN)}


register(FlashModel(Flash))
register(FlashModel(RedFlash))

"""The target slides down a visible ramp and out onto the table."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from pipeline.poses import Floats, pose, quat_about, quat_multiply, quat_rotate, yawed

from ..closed_form import Along, ClosedFormModel, turns, ways
from ..contract import MotionRequest, Streams
from ..pace import draw_pace
from ..scenery import Piece, Prop, standing
from . import register

SLOPE, FOOT = (0.2, 0.4), (0.03, 0.07)  # rad; m from the foot of the ramp to the meeting
FILLET = 0.15  # m, radius of the bend at the foot
STEEL = (0.42, 0.50, 0.58)
THIN = 0.002  # m, half thickness of the ramp


@dataclass(frozen=True)
class Ramp(Along):
    """The advance is arc length: straight down at `slope_angle` rad, a bend of radius 15 cm, then
    level for the last `foot` m. The body tilts with its path."""

    kind: ClassVar[str] = "ramp"
    heading: float
    slope_angle: float
    foot: float
    width: float
    length: float

    def _bend(self, s: Floats) -> tuple[Floats, Floats, Floats]:
        """The pitch (rad), and the way back (m) along bend and straight."""
        back = np.maximum(-np.asarray(s) - self.foot, 0.0)
        pitch = np.minimum(back / FILLET, self.slope_angle)
        return pitch, FILLET * pitch, back - FILLET * pitch

    def at(self, s: Floats) -> Floats:
        s = np.asarray(s, float)
        pitch, _, straight = self._bend(s)
        ahead = np.maximum(s, -self.foot) - FILLET * np.sin(pitch) - straight * np.cos(pitch)
        up = FILLET * (1 - np.cos(pitch)) + straight * np.sin(pitch)
        way = [ahead * np.cos(self.heading), ahead * np.sin(self.heading), up]
        place = np.array(self.end[:3]) + np.stack(way, -1)
        turn = quat_multiply(turns(ways(self.heading)[1], pitch), np.array(self.end[3:]))
        return np.concatenate([place, turn], -1)

    def slope(self, s: Floats) -> Floats:
        pitch, _, _ = self._bend(s)
        c = np.cos(pitch)
        line = np.stack([c * np.cos(self.heading), c * np.sin(self.heading), -np.sin(pitch)], -1)
        bending = (pitch > 0) & (pitch < self.slope_angle)
        return np.concatenate([line, -(bending / FILLET)[..., None] * ways(self.heading)[1]], -1)

    def scenery(self) -> tuple[Prop, ...]:
        bend = FILLET * self.slope_angle
        cuts = [*np.linspace(self.foot, self.foot + bend, 5), self.foot + bend + self.length]
        turn = yawed((0, 0, 0), self.heading)[3:]
        boards = []
        for near, far in pairwise(cuts):
            middle = np.array(-(near + far) / 2)
            pitch = float(self._bend(middle)[0])
            tilt = quat_multiply(turn, quat_about((0, 1, 0), pitch))
            place = self.at(middle)[:3] - quat_rotate(tilt, np.array([0.0, 0.0, THIN]))
            size = ((far - near) / 2 + 0.001, self.width / 2, THIN)
            boards.append(Piece("box", size, pose(place, tilt), STEEL))
        return (Prop("ramp", tuple(boards), standing(pose()), solid=True),)


class RampModel(ClosedFormModel[Ramp]):
    def shape(self, asked: MotionRequest, streams: Streams) -> dict[str, Any]:
        pace = draw_pace(asked, streams.shape)
        slope, foot = float(streams.shape.uniform(*SLOPE)), float(streams.shape.uniform(*FOOT))
        farthest = -float(pace.advance(np.linspace(-asked.lead, asked.duration, 200)).min())
        length = max(0.05, farthest - foot - FILLET * slope) + asked.radius + 0.02
        sizes = {"foot": foot, "width": 2 * asked.radius + 0.02, "length": length}
        return {"pace": pace, "slope_angle": slope, **sizes}


register(RampModel(Ramp))

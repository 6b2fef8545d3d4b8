"""A visible hand brings the target by minimum-jerk motions."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, pose, quat_multiply

from ..closed_form import ClosedForm, ClosedFormModel, common, headings, turns
from ..contract import MotionRequest, Streams, described
from ..scenery import Piece, Prop
from . import register

PEAK = 1.875  # greatest speed of a minimum-jerk motion in mean speeds
TURN = (0.15, 0.45)  # rad
RISE = (-0.2, 0.5)  # rad: elevation of where it comes from
SKIN = (0.86, 0.66, 0.54)
PART = (0.25, 0.45)  # share of time and way that the first piece takes


@dataclass(frozen=True)
class Handed(ClosedForm):
    """A minimum-jerk motion from `start` (x, y, z; m from the end), with a turn by `angle` rad
    about `about`. The share of the path is 10 u^3 - 15 u^4 + 6 u^5.
    With a `stop` the hand rests at that share until `resumes`; `bow` (m) bends the path upwards."""

    kind: ClassVar[str] = "handed"
    start: tuple[float, float, float]
    about: tuple[float, float, float]
    angle: float
    bow: float = 0.0
    stop: float = 1.0
    resumes: float = 1.0
    thickness: float = 0.03

    def _pieces(self) -> list[tuple[float, float, float, float]]:
        """Shares of time from and to, and of the way from and to."""
        whole = [(0.0, self.stop, 0.0, self.stop)]
        return whole if self.stop == 1.0 else [*whole, (self.resumes, 1.0, self.stop, 1.0)]

    def _share(self, t: Floats) -> tuple[Floats, Floats]:
        total = self.duration + self.lead
        share, rate = np.zeros(np.shape(t)), np.zeros(np.shape(t))
        for t0, t1, w0, w1 in self._pieces():
            u = np.clip(((t + self.lead) / total - t0) / (t1 - t0), 0.0, 1.0)
            share += (w1 - w0) * u**3 * (10 - 15 * u + 6 * u**2)
            rate += (w1 - w0) * 30 * u**2 * (1 - u) ** 2 / ((t1 - t0) * total)
        return share, rate

    def place(self, t: Floats) -> Floats:
        share, _ = self._share(t)
        left = (1 - share)[..., None]
        at = np.array(self.end[:3]) + left * np.array(self.start)
        at[..., 2] += 4 * self.bow * share * (1 - share)
        turn = turns(self.about, self.angle * (1 - share))
        return np.concatenate([at, quat_multiply(turn, np.array(self.end[3:]))], -1)

    def rates(self, t: Floats) -> Floats:
        share, rate = self._share(t)
        line = -rate[..., None] * np.array(self.start)
        line[..., 2] += 4 * self.bow * (1 - 2 * share) * rate
        return np.concatenate([line, -self.angle * rate[..., None] * np.array(self.about)], -1)

    def breakpoints(self) -> Floats:
        if self.stop == 1.0:
            return np.zeros(0)
        return np.array([self.stop, self.resumes]) * (self.duration + self.lead) - self.lead

    def scenery(self) -> tuple[Prop, ...]:
        palm = Piece("box", (0.040, 0.045, 0.009), pose((0, 0, -0.010)), SKIN)
        places = [pose((x, -0.072, -0.009)) for x in (-0.030, -0.010, 0.010, 0.030)]
        fingers = [Piece("box", (0.0085, 0.028, 0.007), place, SKIN) for place in places]
        arm = Piece("box", (0.028, 0.13, 0.022), pose((0, 0.17, -0.018)), (0.25, 0.35, 0.55))
        return (Prop("hand", (palm, *fingers, arm), self._under),)

    def _under(self, t: ArrayLike) -> Floats:
        poses = self.pose(t)
        share, _ = self._share(np.maximum(np.asarray(t, float), -self.lead))
        poses[..., 3:] = turns(self.about, self.angle * (1 - share))
        return poses


class HandedModel(ClosedFormModel[Handed]):
    levels = described(
        "one straight minimum-jerk motion",
        "one minimum-jerk motion on an arc",
        "a motion that stops and resumes",
    )

    def candidates(self, asked: MotionRequest, streams: Streams) -> Iterator[Handed]:
        rng, total = streams.shape, asked.duration + asked.lead
        peak = PEAK if asked.speed_bound == "maximum" else 1.0
        speed = asked.alpha * rng.uniform(0.5, 0.9) / peak
        angle, rise, part = (float(rng.uniform(*r)) for r in (TURN, RISE, PART))
        resumes = part + 0.15
        if asked.level == 3 and asked.speed_bound == "maximum":
            speed *= 1 - resumes
        way = speed * total if asked.level else 0.0
        axis = rng.normal(size=3)
        about = tuple((axis / np.linalg.norm(axis)).tolist())
        for heading in sorted(headings(streams), key=lambda a: np.sin(a) < 0.3):
            level = way * np.cos(rise) * (0.8 if asked.level == 2 else 1.0)
            start = (level * np.cos(heading), level * np.sin(heading), way * np.sin(rise) * 0.8)
            shape: dict[str, Any] = {"start": tuple(map(float, start)), "about": about}
            shape["angle"] = angle if asked.level else 0.0
            if asked.level == 2:
                shape |= {"bow": 0.15 * way}
            if asked.level == 3:
                shape |= {"stop": part, "resumes": resumes}
            yield Handed(**common(asked), **shape)


register(HandedModel(Handed))

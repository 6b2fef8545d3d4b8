"""A model of motions that is not of the package: a sinusoid along x during which the target
turns."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad

from pipeline.motion.contract import Array, Features, Level, MotionRequest, NoMotion, Streams
from pipeline.poses import compose, yawed

RATE = 2 * np.pi / 1.5  # rad/s


@dataclass(frozen=True)
class Sway:
    """x = x_end + amplitude * sin(RATE * (t - duration)); the yaw turns by `turn` rad/s. The target
    stands before -lead."""

    level: int
    alpha: float
    duration: float
    lead: float
    end: tuple[float, ...]
    amplitude: float
    turn: float

    @property
    def model(self) -> str:
        return "sway"

    def pose(self, t: ArrayLike) -> Array:
        since = np.maximum(np.asarray(t, float), -self.lead) - self.duration
        poses = np.stack(
            [compose(self.end, yawed((0, 0, 0), self.turn * s)) for s in since.ravel()]
        ).reshape(*since.shape, 7)
        poses[..., 0] += self.amplitude * np.sin(RATE * since)
        return poses

    def twist(self, t: ArrayLike) -> Array:
        t = np.asarray(t, float)
        found = np.zeros((*t.shape, 6))
        found[..., 0] = self.amplitude * RATE * np.cos(RATE * (t - self.duration))
        found[..., 5] = self.turn
        return found * (t >= -self.lead)[..., None]

    def breakpoints(self) -> Array:
        return np.zeros(0)

    def features(self) -> Features:
        time = self.duration + self.lead
        length = (
            quad(lambda s: abs(np.cos(RATE * s)), 0, time, limit=200)[0]
            * abs(self.amplitude)
            * RATE
        )
        top = abs(self.amplitude) * RATE
        return Features(length / time, top, top, abs(self.amplitude * np.sin(RATE * time)))

    def scenery(self) -> tuple[()]:
        return ()

    def to_json(self) -> str:
        return json.dumps({"model": self.model} | asdict(self))


class SwayModel:
    """One level: the amplitude follows from alpha."""

    name = "sway"
    version = 1
    levels: Mapping[int, Level] = MappingProxyType(
        {4: Level("swaying from side to side", "#7c3aed")}
    )

    def draw(self, asked: MotionRequest, streams: Streams) -> Sway:
        turn = float(streams.shape.uniform(0.2, 0.6))
        end = tuple(np.asarray(asked.end_pose, float).tolist())
        for sign in streams.direction.permutation([-1.0, 1.0]).tolist():
            found = Sway(
                asked.level,
                asked.alpha,
                asked.duration,
                asked.lead,
                end,
                sign * asked.alpha / RATE,
                turn,
            )
            if asked.free is None or asked.free(found):
                return found
        raise NoMotion(asked, {"blocked": 2})

    def stand(self, asked: MotionRequest, streams: Streams) -> Sway:
        return Sway(
            0,
            0.0,
            asked.duration,
            asked.lead,
            tuple(np.asarray(asked.end_pose, float).tolist()),
            0.0,
            0.0,
        )

    def read(self, values: Mapping[str, Any]) -> Sway:
        given = {key: value for key, value in values.items() if key != "model"}
        try:
            return Sway(**given | {"end": tuple(given["end"])})
        except (KeyError, TypeError) as error:
            raise ValueError(f"this is not a target motion: {error!r}") from error

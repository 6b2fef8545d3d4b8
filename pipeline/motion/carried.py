"""What rides on the same belt or disc as a target."""

import json
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, compose

from .contract import Features, TargetMotion
from .scenery import Prop

CARRIED: Final = "carried"
"""In place of a model in `movers`: the body moves with the target, as one rigid thing."""


@dataclass(frozen=True, eq=False)
class Rider:
    """A body at a fixed pose `at` (7,) relative to `target`."""

    target: TargetMotion
    at: Floats

    @property
    def model(self) -> str:
        return CARRIED

    @property
    def level(self) -> int:
        return self.target.level

    @property
    def alpha(self) -> float:
        return self.target.alpha

    @property
    def duration(self) -> float:
        return self.target.duration

    @property
    def lead(self) -> float:
        return self.target.lead

    def pose(self, t: ArrayLike) -> Floats:
        return compose(self.target.pose(t), self.at)

    def twist(self, t: ArrayLike) -> Floats:
        twist, arm = self.target.twist(t), self.pose(t)[..., :3] - self.target.pose(t)[..., :3]
        linear = twist[..., :3] + np.cross(twist[..., 3:], arm)
        return np.concatenate([linear, twist[..., 3:]], -1)

    def breakpoints(self) -> Floats:
        return self.target.breakpoints()

    def features(self) -> Features:
        return self.target.features()

    def scenery(self) -> tuple[Prop, ...]:
        return ()

    def to_json(self) -> str:
        return json.dumps({"model": CARRIED, "at": np.asarray(self.at).tolist()}, allow_nan=False)

"""The motion of a target together with those of bodies that move beside it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from pipeline.motion.contract import Array, Features, TargetMotion
from pipeline.motion.scenery import Prop


@runtime_checkable
class Accompanied(Protocol):
    """A motion beside which other bodies move, by name."""

    @property
    def others(self) -> Mapping[str, TargetMotion]: ...


@dataclass(frozen=True, eq=False)
class Company:
    """What moves in an episode: the target, and `others` by name. As a motion it is the target's;
    its scenery is that of all."""

    target: TargetMotion
    others: Mapping[str, TargetMotion]

    @property
    def model(self) -> str:
        return self.target.model

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

    def pose(self, t: ArrayLike) -> Array:
        return self.target.pose(t)

    def twist(self, t: ArrayLike) -> Array:
        return self.target.twist(t)

    def breakpoints(self) -> Array:
        return self.target.breakpoints()

    def features(self) -> Features:
        return self.target.features()

    def scenery(self) -> tuple[Prop, ...]:
        """The target's, and that of the others under names that begin with theirs."""
        more = [
            replace(p, name=f"{name}_{p.name}")
            for name, motion in self.others.items()
            for p in motion.scenery()
        ]
        return (*self.target.scenery(), *more)

    def to_json(self) -> str:
        """The target's JSON with those of the others under the key `others`."""
        others = {name: json.loads(motion.to_json()) for name, motion in self.others.items()}
        return json.dumps(json.loads(self.target.to_json()) | {"others": others}, allow_nan=False)


def others_of(motion: object) -> Mapping[str, TargetMotion]:
    """What moves beside the target of a motion, by name; nothing beside most."""
    return motion.others if isinstance(motion, Accompanied) else {}

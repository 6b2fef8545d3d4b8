"""Models of target motions by name, and motions to a meeting."""

import json
import sys
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.errors import DominoError
from pipeline.motion.carried import CARRIED, Rider
from pipeline.motion.changed import Changed, changes_of
from pipeline.motion.contract import (
    Features,
    Level,
    MotionModel,
    MotionRequest,
    NoMotion,
    Streams,
    TargetMotion,
)
from pipeline.motion.scenery import Prop
from pipeline.poses import Floats
from pipeline.registry import Registry, place_in


@runtime_checkable
class Accompanied(Protocol):
    @property
    def others(self) -> Mapping[str, TargetMotion]: ...


@dataclass(frozen=True, eq=False)
class Company:
    """The target and `others` by name; as a motion it is the target's."""

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

    def pose(self, t: ArrayLike) -> Floats:
        return self.target.pose(t)

    def twist(self, t: ArrayLike) -> Floats:
        return self.target.twist(t)

    def breakpoints(self) -> Floats:
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
    """What moves beside the target of a motion, by name."""
    return motion.others if isinstance(motion, Accompanied) else {}


PLANAR = "planar"
STILL = Level("the target stands still", "#6b7280")
"""Level 0 of every model."""

_MODULES = {"drop": "ballistic", "toss": "ballistic", "twice": "tunnel", "flash_red": "flash"}
_MODULES |= {"shuffle": "turntable"}
_NAMES = (
    "drop toss circle conveyor flash flash_red handed pendulum planar pushed ramp rebound rolling"
    " shuffle sinusoid tunnel turntable twice"
)
MODELS: Registry[MotionModel] = Registry(
    "motion", {n: f"{__name__}.{_MODULES.get(n, n)}" for n in _NAMES.split()}
)
"""Models by name; a module of this folder registers its model when that is asked for."""


def register(model: MotionModel) -> MotionModel:
    """Enter a model. Raises ValueError if taken or describing level 0."""
    if 0 in model.levels:
        raise ValueError(
            f"motion {model.name!r}: level 0 stands still in every model, so it must not be among"
            " its levels"
        )
    place_in(sys._getframemodulename(1), type(model))
    return MODELS.add(model.name, model)


class UnknownMotion(DominoError, ValueError):
    """A motion of a model that is not installed."""


def levels_of(name: str) -> dict[int, Level]:
    """The levels of a model, 0 included. Raises UnknownName."""
    return {0: STILL, **MODELS[name].levels}


def level_of(name: str, level: int) -> Level:
    """How a level is described and drawn; also one that is not installed here."""
    known = levels_of(name) if name in MODELS else {0: STILL}
    return known.get(level, Level(f"level {level} of {name}", STILL.colour))


def level_name(name: str, level: int) -> str:
    """A level's number, after the model's name unless it is the paper's."""
    return f"level {level}" if name == PLANAR or level == 0 else f"{name} level {level}"


def motion_from_json(text: str) -> TargetMotion:
    """Inverse of `TargetMotion.to_json`. Raises ValueError, or UnknownMotion for a missing
    model.
    """
    values: Any = json.loads(text)
    if not isinstance(values, dict):
        raise ValueError("this is not a target motion: it is no JSON object")
    if changes := values.pop("changes", None):
        return Changed(motion_from_json(json.dumps(values)), changes_of(changes))
    name = values.get("model", PLANAR)
    if name not in MODELS:
        raise UnknownMotion(
            f"an episode needs the motion {str(name)[:80]!r}, which is not installed: give"
            " --plugins with its directory"
        )
    if not isinstance(others := values.pop("others", {}), dict):
        raise ValueError("this is not a target motion: its others are no JSON object")
    target = MODELS[name].read(values)
    beside = {who: _beside(target, values) for who, values in others.items()}
    return Company(target, beside) if beside else target


def _beside(target: TargetMotion, values: Any) -> TargetMotion:
    if not isinstance(values, dict) or values.get("model") != CARRIED:
        return motion_from_json(json.dumps(values))
    at = np.asarray(values.get("at"), float)
    if at.shape != (7,) or not np.isfinite(at).all():
        raise ValueError("this is not a target motion: what it carries has no pose of 7 numbers")
    return Rider(target, at)


def back_calculate_motion(
    asked: MotionRequest, streams: Streams, model: str = PLANAR
) -> TargetMotion:
    """A motion of `model` that keeps `asked`; level 0 and alpha 0 stand. Raises NoMotion,
    UnknownName, ValueError for the level.
    """
    if asked.level not in (levels := levels_of(model)):
        raise ValueError(
            f"level {asked.level!r} is unknown: levels of {model} are {', '.join(map(str, levels))}"
        )
    if asked.level == 0 or asked.alpha == 0:
        return MODELS[model].stand(asked, streams)
    if asked.moving == (1.0,):
        return MODELS[model].draw(asked, streams)
    return _late(asked, streams, model)


def _late(asked: MotionRequest, streams: Streams, model: str) -> TargetMotion:
    """The motion for the first feasible share of `asked.moving`. Raises the first try's
    NoMotion.
    """
    total, refused = asked.lead + asked.duration, list[NoMotion]()
    kept = replace(asked, candidates=1) if asked.level == 1 else asked
    for share in asked.moving:
        try:
            return MODELS[model].draw(
                replace(kept, lead=share * total - asked.duration), deepcopy(streams)
            )
        except NoMotion as no:
            refused.append(no)
    raise refused[0]

"""Models of target motions by name, and motions to a meeting."""

import json
import sys
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.data.errors import DominoError
from pipeline.registry import Registry, place_in

from ..contract import Level, MotionModel, MotionRequest, NoMotion, Streams, TargetMotion
from ..wrapped import CARRIED, Changed, Company, Rider, changes_of

PLANAR = "planar"
STILL = Level("the target stands still", "#6b7280")
"""Level 0 of every model."""

_MODULES = {
    "ballistic": "drop toss",
    "conveyor": "conveyor flash flash_red",
    "curves": "circle sinusoid",
    "rolling": "rebound rolling",
    "tunnel": "tunnel twice",
    "turntable": "shuffle turntable",
} | {name: name for name in ("handed", "pendulum", "planar", "pushed", "ramp")}
_PLACES = ((n, f"{__name__}.{module}") for module, names in _MODULES.items() for n in names.split())
MODELS: Registry[MotionModel] = Registry("motion", dict(sorted(_PLACES)))
"""Models by name; a module of this folder registers its model when that is asked for."""


def register(model: MotionModel) -> MotionModel:
    """Enter a model. Raises ValueError if taken or describing level 0."""
    if 0 in model.levels:
        raise ValueError(f"motion {model.name!r}: has level 0, which stands still in every model")
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
    """Inverse of `to_json`. Raises ValueError, or UnknownMotion for a missing model."""
    values: Any = json.loads(text)
    if not isinstance(values, dict):
        raise ValueError("this is not a target motion: it is no JSON object")
    if changes := values.pop("changes", None):
        return Changed(motion_from_json(json.dumps(values)), changes_of(changes))
    name = values.get("model", PLANAR)
    if name not in MODELS:
        missing = f"the motion {str(name)[:80]!r}, which is not installed"
        raise UnknownMotion(f"an episode needs {missing}: give --plugins with its directory")
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
    UnknownName, ValueError for the level."""
    if asked.level not in (levels := levels_of(model)):
        known = f"levels of {model} are {', '.join(map(str, levels))}"
        raise ValueError(f"level {asked.level!r} is unknown: {known}")
    if asked.level == 0 or asked.alpha == 0:
        return MODELS[model].stand(asked, streams)
    if asked.moving == (1.0,):
        return MODELS[model].draw(asked, streams)
    return _late(asked, streams, model)


def _late(asked: MotionRequest, streams: Streams, model: str) -> TargetMotion:
    """The motion for the first feasible share of `asked.moving`. Raises NoMotion."""
    refused, kept = list[NoMotion](), replace(asked, candidates=1) if asked.level == 1 else asked
    for share in asked.moving:
        late = replace(kept, lead=share * asked.total - asked.duration)
        try:
            return MODELS[model].draw(late, deepcopy(streams))
        except NoMotion as no:
            refused.append(no)
    raise refused[0]

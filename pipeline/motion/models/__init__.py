"""Models of target motions by name."""

import json
import sys
from typing import Any

from pipeline.data.errors import DominoError
from pipeline.motion.company import Company
from pipeline.motion.contract import Level, MotionModel, TargetMotion
from pipeline.registry import Registry, place_in

PLANAR = "planar"
STILL = Level("the target stands still", "#6b7280")
"""Level 0 of every model."""

_MODULES = {"drop": "ballistic", "toss": "ballistic"}
_NAMES = "drop toss circle conveyor handed pendulum planar pushed ramp rolling sinusoid turntable"
MODELS: Registry[MotionModel] = Registry(
    "motion", {n: f"{__name__}.{_MODULES.get(n, n)}" for n in _NAMES.split()}
)
"""Models by name. A module of this folder is imported, and registers its model, when that is asked
for."""


def register(model: MotionModel) -> MotionModel:
    """Enter a model under its name. Raises ValueError if the name is taken, or if it describes
    level 0."""
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
    """How a level is described and drawn; also of a model or a level that is not installed here."""
    known = levels_of(name) if name in MODELS else {0: STILL}
    return known.get(level, Level(f"level {level} of {name}", STILL.colour))


def level_name(name: str, level: int) -> str:
    """A level in tables and plots: its number, after the name of a model that is not the
    paper's."""
    return f"level {level}" if name == PLANAR or level == 0 else f"{name} level {level}"


def motion_from_json(text: str) -> TargetMotion:
    """Inverse of `TargetMotion.to_json`, of any model: text without a `model` is of the model
    `planar`.

    Raises ValueError, naming what is wrong, for text that is no motion, UnknownMotion for that of a
    model that is not installed.
    """
    values: Any = json.loads(text)
    if not isinstance(values, dict):
        raise ValueError("this is not a target motion: it is no JSON object")
    name = values.get("model", PLANAR)
    if name not in MODELS:
        raise UnknownMotion(
            f"an episode needs the motion {str(name)[:80]!r}, which is not installed: give"
            " --plugins with its directory"
        )
    if not isinstance(others := values.pop("others", {}), dict):
        raise ValueError("this is not a target motion: its others are no JSON object")
    target = MODELS[name].read(values)
    return (
        Company(
            target, {who: motion_from_json(json.dumps(values)) for who, values in others.items()}
        )
        if others
        else target
    )

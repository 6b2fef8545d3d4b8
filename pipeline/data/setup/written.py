"""Values of a setup and a recipe as people write them, and what is wrong with one."""

import math
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from pipeline.data.episode.meta import NamedCamera, camera_name
from pipeline.data.names import CAMERAS
from pipeline.data.parsing import SHOWN, show_value

from .brought import bring_light, bring_textures


def check_kind(value: Any, is_switch: bool) -> None:
    """Raise ValueError for NaN, and for true/false in place of a number or a name."""
    parts = value.values() if isinstance(value, Mapping) else value
    parts = [*parts] if isinstance(value, Mapping | list | tuple) else [value]
    if not is_switch and any(isinstance(part, bool) for part in parts):
        raise ValueError("is true or false, but must be a number or a name")
    if any(isinstance(part, float) and math.isnan(part) for part in parts):
        raise ValueError("is NaN, which is no number")


def read_size(value: Any) -> Any:
    if value is not None and (not isinstance(value, list | tuple) or len(value) != 2):
        raise ValueError("must be [width, height] in pixels, such as [320, 240]")
    return value


def read_objects(value: Any) -> Any:
    """ "mug=mug7,mug=mug8" is {mug: [mug7, mug8]}, and one name a list of it."""
    pairs: list[Any] = [*value.items()] if isinstance(value, Mapping) else []
    if isinstance(value, str):
        pairs = [word.strip().split("=") for word in value.split(",")]
    if not isinstance(value, Mapping | str) or any(len(pair) != 2 for pair in pairs):
        raise ValueError("is not written as family=object, such as mug=mug7,can=soda")
    objects: dict[Any, list[str]] = {}
    for family, names in pairs:
        each = names if isinstance(names, list | tuple) else [names]
        objects.setdefault(family, []).extend(str(n).removeprefix("robotwin:") for n in each)
    return objects


def read_textures(value: Any) -> Any:
    is_directory = isinstance(value, str) and value not in ("seen", "unseen")
    return bring_textures(value) if is_directory else value


def read_light(value: Any) -> Any:
    return None if value == "none" else bring_light(value) if isinstance(value, str) else value


def read_cameras(value: Any) -> Any:
    cameras = [_camera(item) for item in (value if isinstance(value, list | tuple) else [value])]
    if len(set(map(camera_name, cameras))) < len(cameras):
        raise ValueError("names a camera twice")
    return tuple(cameras)


def _camera(item: Any) -> str | NamedCamera:
    """A known name, long or short, or a mapping that describes a camera."""
    if isinstance(item, NamedCamera):
        return item
    if isinstance(item, Mapping):
        try:
            return NamedCamera.model_validate(dict(item))
        except ValidationError as error:
            wrong = {str(e["loc"][0])[:SHOWN]: _message(e).lower() for e in error.errors()}
            listed = ", ".join(f"{key} ({message})" for key, message in wrong.items())
            raise ValueError(f"describes a camera with wrong values: {listed}") from error
    for short, long in CAMERAS.items():
        if item in (short, long):
            return short
    known = f"{', '.join(CAMERAS)}, or a mapping with name, link, pose, width, height, fovy"
    raise ValueError(f"holds {show_value(item)}: cameras are {known}")


def explain(
    error: ValidationError,
    model: type[BaseModel],
    values: Mapping[str, Any],
    source: str,
    flags: Mapping[str, str],
) -> str:
    """One line on the first fault of some values: `source` and the key, or its option (`flags`)."""
    first = error.errors()[0]
    key, *inner = [str(part)[:SHOWN] for part in first["loc"]] or [""]
    is_unknown = first["type"] == "extra_forbidden"
    where = flags.get(key) or f"{source}: {key}"
    part_is_wrong = first["type"] == "missing" or first["input"] is not values.get(key)
    if inner and isinstance(first["loc"][-1], str) and not is_unknown and part_is_wrong:
        where += f": {inner[-1]}"
    message = _message(first).replace("Input should be", "must be")
    what = message[0].lower() + message[1:]
    if is_unknown:
        keys = ", ".join(model.model_fields)
        what = f"is not a key of a {model.__name__.lower()}; keys are {keys}"
        what = f"has no {inner[-1]}" if inner else what
    return f"{where} {what} (got {show_value(first['input'])})"


def _message(error: Any) -> str:
    return error["msg"].removeprefix("Value error, ")

"""Configurations in YAML files: those that come with the package, files on top of others, and
settings on top of both."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.data.parsing import ParseError, parse_yaml, read_yaml, show_value
from training.puma.config import Config, parse_config
from training.puma.errors import TrainError

CONFIGS = Path(__file__).parent / "configs"
"""Configurations that come with the package, one YAML file each."""


def read_config(name: str, settings: Sequence[str] = ()) -> Config:
    """A configuration by the name of one that comes with the package, or by a file, changed by
    settings such as `train.steps=10`.

    A file may name another one under `extends`; its own keys come on top. Raises TrainError, one
    line.
    """
    values = _merge(_path(name))
    for setting in settings:
        key, sign, text = setting.partition("=")
        if not sign:
            raise TrainError(f"--set {setting!r}: write key=value, for example train.steps=1000")
        try:
            _put(values, key.split("."), parse_yaml(text))
        except ParseError as error:
            raise TrainError(
                f"--set {show_value(setting)}: {' '.join(str(error).split())}"
            ) from error
    return parse_config(values, name)


def names() -> list[str]:
    """Configurations that come with the package."""
    return sorted(path.stem for path in CONFIGS.glob("*.yaml"))


def _path(name: str) -> Path:
    path = Path(name)
    if path.suffix in (".yaml", ".yml", ".json"):
        return path
    if name not in names():
        raise TrainError(
            f"--config {name!r} is unknown: give a YAML file or one of {', '.join(names())}"
        )
    return CONFIGS / f"{name}.yaml"


def _merge(path: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    path = path.resolve()
    if path in above:
        raise TrainError(f"{path}: extends itself")
    try:
        values = read_yaml(path) or {}
    except ParseError as error:
        raise TrainError(str(error)) from error
    if not isinstance(values, dict):
        raise TrainError(f"{path}: is not a mapping of keys to values")
    base = values.pop("extends", None)
    if base is None:
        return values
    if not isinstance(base, str):
        raise TrainError(
            f"{path}: extends is not the name of a file beside it (got {show_value(base)})"
        )
    return _over(_merge(path.parent / f"{base}.yaml", (*above, path)), values)


def _over(base: dict[str, Any], top: Mapping[str, Any]) -> dict[str, Any]:
    """`top` on `base`, mappings merged key by key."""
    out = dict(base)
    for key, value in top.items():
        old = out.get(key)
        out[key] = _over(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return out


def _put(values: dict[str, Any], keys: list[str], value: Any) -> None:
    for key in keys[:-1]:
        values = values.setdefault(key, {})
        if not isinstance(values, dict):
            raise ParseError(f"{key} is not a part of the configuration")
    values[keys[-1]] = value

"""Policies in files, KIND:PATH?key=value&key=value."""

import hashlib
import importlib.util
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import parse_qsl, urlencode

from pipeline.data.actions import Representation
from pipeline.data.names import EXPORT_RECORD
from pipeline.data.parsing import parse_json, parse_yaml
from pipeline.data.reading import open_regular, read_regular

from .policy import PolicyError, foreign

ACTION_OPTIONS = ("actions", "rotation", "frame")
"""What an action is; `like`, an export, stands for all."""


def stated_actions(options: Mapping[str, Any]) -> Representation:
    """Joints by default. Raises PolicyError."""
    try:
        return Representation(**{k: str(options[k]) for k in ACTION_OPTIONS if k in options})
    except ValueError as error:
        raise PolicyError(str(error)) from error


def expected_actions(text: str) -> Representation | None:
    options = dict(parse_qsl(text.partition("?")[2]))
    return stated_actions(options) if options.keys() & {*ACTION_OPTIONS} else None


def name_actions(text: str, like: Path | None = None) -> str:
    """The name with the actions of an export, its option `like` or `like`, unless written out.
    Raises PolicyError."""
    rest, _, query = text.partition("?")
    given = dict(parse_qsl(query, keep_blank_values=True))
    export = given.pop("like", like)
    if export is None:
        return text
    try:
        options = parse_json(read_regular(Path(export) / EXPORT_RECORD))["options"]
        recorded = {key: str(options[key]) for key in ACTION_OPTIONS if key in options}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise PolicyError(f"like={export}: is no export that can be read: {error}") from error
    written = urlencode({**recorded, **given})
    return f"{rest}?{written}" if written else rest


def digest_of(files: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in files:
        try:
            with open_regular(path) as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        except OSError as error:
            raise PolicyError(f"--policy {path}: cannot be read ({error.strerror})") from error
    return digest.hexdigest()[:8]


def module_of(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"domino_policy_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise PolicyError(f"{path}: is no Python file")
    module = importlib.util.module_from_spec(spec)
    with foreign(f"{path}: cannot be loaded"):
        spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class PolicySettings:
    """A path and options, read as YAML; `query` is their text."""

    kind: str
    path: str
    options: dict[str, Any] = field(default_factory=dict)
    query: str = ""

    @property
    def text(self) -> str:
        return "".join(f",{key}={value}" for key, value in sorted(self.options.items()))

    def at(self, path: Path) -> str:
        return f"{self.kind}:{path.resolve()}{self.query and f'?{self.query}'}"

    def take(self, *known: str) -> dict[str, Any]:
        if unknown := sorted(set(self.options) - set(known)):
            what = f"option {unknown[0]!r} is unknown: options are {', '.join(known)}"
            raise PolicyError(f"--policy {self.kind}:{self.path}: {what}")
        return self.options


def parse_settings(text: str) -> PolicySettings:
    kind, _, rest = text.partition(":")
    path, mark, query = rest.partition("?")
    try:
        pairs = dict(parse_qsl(query, keep_blank_values=True, strict_parsing=bool(mark)))
        options = {key: parse_yaml(value) for key, value in pairs.items()}
    except ValueError as error:
        raise PolicyError(f"--policy {text!r}: write {kind}:PATH?key=value&key=value") from error
    if not path:
        raise PolicyError(f"--policy {text!r}: write {kind}:PATH")
    return PolicySettings(kind, path, options, query)

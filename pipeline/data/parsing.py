"""Reads numbers, JSON and YAML; the base of models that files hold."""

import json
import reprlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from .errors import DominoError, one_line
from .reading import open_regular

SHOWN = 80  # characters of a value in a message
LONGEST_LINE = 4096
LARGEST_FILE = 1_000_000  # bytes of a file that a person writes
MOST_VALUES = 200_000  # in such a file; aliases of YAML count each time they are used
LARGEST_NUMBER = 10**15  # whole numbers up to here are exact as floats

FEWEST_PIXELS, MOST_PIXELS = 16, 4096


class Strict(BaseModel):
    """A record without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def unless(usual: Any) -> FieldInfo:
    """A field that is left out of JSON at its usual value, as earlier versions left it out."""
    return Field(exclude_if=lambda value: value == usual)


def first_fault(error: ValidationError) -> str:
    """The place and the message of the first of pydantic's errors."""
    first = error.errors()[0]
    return f"{'.'.join(map(str, first['loc']))[:SHOWN]}: {first['msg']}"


class ParseError(DominoError, ValueError):
    """What is wrong with a text or file; the caller puts the option or key in front."""


def show_value(value: Any) -> str:
    """A value on one short line."""
    text = reprlib.Repr(
        maxlevel=2, maxdict=3, maxlist=4, maxtuple=4, maxstring=60, maxlong=30, maxother=60
    ).repr(value)
    return " ".join(text.split())[:SHOWN]


def whole(text: str, low: int = -LARGEST_NUMBER, high: int = LARGEST_NUMBER) -> int:
    """A whole number in [low, high]. Raises ParseError."""
    return _number(int, text, low, high, f"is not a whole number from {low} to {high}")


def real(text: str, low: float = -LARGEST_NUMBER, high: float = LARGEST_NUMBER) -> float:
    """A finite number in [low, high]. Raises ParseError."""
    return _number(float, text, low, high, f"is not a number from {low:g} to {high:g}")


def line(text: str, longest: int = LONGEST_LINE) -> str:
    """A printable text on one line. Raises ParseError."""
    if not text.strip() or not text.isprintable() or len(text) > longest:
        raise ParseError(f"is not one line of 1 to {longest} characters")
    return text


def pixels(text: str) -> tuple[int, int]:
    """ "640x480" as (width, height). Raises ParseError."""
    try:
        width, height = (whole(side, FEWEST_PIXELS, MOST_PIXELS) for side in text.split("x"))
    except ValueError as error:
        sides = f"each side has {FEWEST_PIXELS} to {MOST_PIXELS}"
        raise ParseError(f"is not WIDTHxHEIGHT in pixels, such as 640x480: {sides}") from error
    return width, height


def parse_json(text: str | bytes) -> Any:
    """Plain data. Raises ParseError."""
    return _parse("JSON", json.loads, text)


def parse_yaml(text: str | bytes) -> Any:
    """Plain data without tags or a key twice. Raises ParseError."""
    return bounded(_parse("YAML", lambda given: yaml.load(given, _Loader), text))


def read_json(path: Path) -> Any:
    """As `parse_json` of a file, which the ParseError names."""
    return _read(path, lambda data: bounded(parse_json(data)))


def read_yaml(path: Path) -> Any:
    """As `parse_yaml` of a file, which the ParseError names."""
    return _read(path, parse_yaml)


def read_mapping(path: Path, example: str) -> dict[str, Any]:
    """The keys of a YAML mapping such as `example`. Raises ParseError."""
    values = read_yaml(path)
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise ParseError(f"{path}: is not a mapping of keys to values, like `{example}`")
    return values


def bounded[T](values: T) -> T:
    """The same plain data. Raises ParseError for more than MOST_VALUES values."""
    left, count = [values], 0
    while left:
        value, count = left.pop(), count + 1
        if count > MOST_VALUES:
            raise ParseError(f"holds more than {MOST_VALUES} values")
        if isinstance(value, dict | list):
            left += value.values() if isinstance(value, dict) else value
    return values


def _number[N: (int, float)](
    kind: Callable[[str], N], text: str, low: N, high: N, message: str
) -> N:
    try:
        number = kind(text)
    except ValueError as error:
        raise ParseError(message) from error
    if not low <= number <= high:
        raise ParseError(message)
    return number


def _parse(kind: str, parse: Callable[[str], Any], text: str | bytes) -> Any:
    try:
        return parse(text if isinstance(text, str) else text.decode())
    except RecursionError as error:
        raise ParseError("is nested too deeply") from error
    except (ValueError, yaml.YAMLError) as error:
        raise ParseError(f"is not {kind} ({one_line(error)})") from error


def _read(path: Path, parse: Callable[[bytes], Any]) -> Any:
    try:
        with open_regular(path) as file:
            data = file.read(LARGEST_FILE + 1)
        if len(data) > LARGEST_FILE:
            raise ParseError(f"has more than {LARGEST_FILE} bytes")
        return parse(data)
    except ParseError as error:
        raise ParseError(f"{path}: {error}") from error
    except OSError as error:
        raise ParseError(f"{path}: cannot be read ({error.strerror})") from error


class _Loader(yaml.SafeLoader):
    """YAML in which no mapping has a key twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if twice := {key for key in keys if keys.count(key) > 1}:
            raise ParseError(f"{show_value(min(twice))} is given twice")
        return super().construct_mapping(node, deep)

"""Reads numbers, names, JSON and YAML that people write: bounded in length, size and depth, with
one line for what is wrong.

Every option, recipe, configuration and settings file goes through here, so that `1_0`, a line
break, a list nested 20,000 times or a file in another encoding is refused everywhere, and in the
same words.
"""

import json
import re
import reprlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from pipeline.data.errors import DominoError

SHOWN = 80
"""Characters of a value in a message."""

LONGEST_LINE = 4096
LARGEST_FILE = 1_000_000
"""Bytes of a file that a person writes."""

DEEPEST, MOST_VALUES = 30, 200_000
"""Levels of nesting and number of values in such a file; aliases of YAML count each time they are
used."""

LARGEST_NUMBER = 10**15
"""Whole numbers up to here are exact as floats, which JSON has for its numbers."""

FEWEST_PIXELS, MOST_PIXELS = 16, 4096

_WHOLE = re.compile(r"[+-]?[0-9]{1,20}")
_REAL = re.compile(r"[+-]?(?:[0-9]{1,40}(?:\.[0-9]{0,40})?|\.[0-9]{1,40})(?:[eE][+-]?[0-9]{1,4})?")
_PIXELS = re.compile(r"([0-9]{1,9})x([0-9]{1,9})")


class ParseError(DominoError, ValueError):
    """A text or file that cannot be used. The message says what is wrong; whoever knows the option
    or key puts it in front."""


def show_value(value: Any) -> str:
    """A value as a message shows it: short, on one line."""
    text = reprlib.Repr(
        maxlevel=2, maxdict=3, maxlist=4, maxtuple=4, maxstring=60, maxlong=30, maxother=60
    ).repr(value)
    return " ".join(text.split())[:SHOWN]


def whole(text: str, low: int = -LARGEST_NUMBER, high: int = LARGEST_NUMBER) -> int:
    """A whole number in [low, high], written in the digits 0-9. Raises ParseError."""
    if not _WHOLE.fullmatch(text) or not low <= int(text) <= high:
        raise ParseError(f"is not a whole number from {low} to {high}")
    return int(text)


def real(text: str, low: float = -LARGEST_NUMBER, high: float = LARGEST_NUMBER) -> float:
    """A finite number in [low, high], such as 0.25 or 1e-3. Raises ParseError."""
    if not _REAL.fullmatch(text) or not low <= float(text) <= high:
        raise ParseError(f"is not a number from {low:g} to {high:g}")
    return float(text)


def line(text: str, longest: int = LONGEST_LINE) -> str:
    """A text on one line, of characters that can be shown. Raises ParseError."""
    if not text.strip():
        raise ParseError("is empty: leave it out, or write something")
    if len(text) > longest:
        raise ParseError(f"has {len(text)} characters: at most {longest} are allowed")
    if not text.isprintable():
        raise ParseError("holds a line break or a control character: write it on one line")
    return text


def pixels(text: str) -> tuple[int, int]:
    """ "640x480" as (width, height), each 16 to 4096. Raises ParseError."""
    found = _PIXELS.fullmatch(text)
    if found is None or not all(
        FEWEST_PIXELS <= int(side) <= MOST_PIXELS for side in found.groups()
    ):
        raise ParseError(
            f"is not WIDTHxHEIGHT in pixels, such as 640x480: each side has {FEWEST_PIXELS} to"
            f" {MOST_PIXELS}"
        )
    return int(found[1]), int(found[2])


def parse_json(text: str | bytes) -> Any:
    """Plain data of a JSON text. Raises ParseError for a text that is none, is nested too deeply,
    or has a key twice."""
    try:
        return json.loads(text, object_pairs_hook=_once)
    except RecursionError as error:
        raise ParseError("is nested too deeply") from error
    except ValueError as error:
        raise ParseError(_describe_error(error)) from error


def parse_yaml(text: str | bytes) -> Any:
    """Plain data of a YAML text, within the bounds of this module: no key twice, no tags, 1:30 is a
    text. Raises ParseError."""
    try:
        values = yaml.load(text.decode() if isinstance(text, bytes) else text, _Loader)
    except RecursionError as error:
        raise ParseError("is nested too deeply") from error
    except yaml.YAMLError as error:
        mark, problem = (
            getattr(error, "problem_mark", None),
            getattr(error, "problem", None) or str(error).splitlines()[0],
        )
        raise ParseError(
            f"is not YAML ({f'line {mark.line + 1}: ' if mark is not None else ''}{problem})"
        ) from error
    except ValueError as error:
        raise ParseError(_describe_error(error)) from error
    return bounded(values)


def read_json(path: Path) -> Any:
    """Plain data of a JSON file that a person may have written. Raises ParseError, which names the
    file."""
    return _read(path, lambda data: bounded(parse_json(data)))


def read_yaml(path: Path) -> Any:
    """Plain data of a YAML file. Raises ParseError, which names the file."""
    return _read(path, parse_yaml)


def read_mapping(path: Path, example: str) -> dict[str, Any]:
    """The keys of a YAML file that holds a mapping; `example` shows one in the message. Raises
    ParseError."""
    values = read_yaml(path)
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise ParseError(f"{path}: is not a mapping of keys to values, like `{example}`")
    return values


def bounded[T](values: T) -> T:
    """The same plain data. Raises ParseError if it is nested deeper than DEEPEST or has more than
    MOST_VALUES values."""
    level: list[Any] = [values]
    count = 0
    for _ in range(DEEPEST + 1):
        below: list[Any] = []
        for value in level:
            parts = (
                list(value.values())
                if isinstance(value, dict)
                else value
                if isinstance(value, list)
                else []
            )
            count += len(parts)
            if count > MOST_VALUES:
                raise ParseError(f"holds more than {MOST_VALUES} values")
            below += parts
        if not below:
            return values
        level = below
    raise ParseError(f"is nested too deeply: at most {DEEPEST} levels are allowed")


def _read(path: Path, parse: Callable[[bytes], Any]) -> Any:
    try:
        with open(path, "rb") as file:
            data = file.read(LARGEST_FILE + 1)
        if len(data) > LARGEST_FILE:
            raise ParseError(f"has more than {LARGEST_FILE} bytes")
        return parse(data)
    except ParseError as error:
        raise ParseError(f"{path}: {error}") from error
    except OSError as error:
        raise ParseError(f"{path}: cannot be read ({error.strerror})") from error


def _describe_error(error: ValueError) -> str:
    """What is wrong with a text, from the error of a parser."""
    if isinstance(error, UnicodeDecodeError):
        return f"is not UTF-8 text ({error.reason})"
    kind = (
        "is not JSON"
        if isinstance(error, json.JSONDecodeError)
        else "holds a value that cannot be read"
    )
    return (
        str(error) if isinstance(error, ParseError) else f"{kind} ({show_value(str(error))[1:-1]})"
    )


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    _check_once([key for key, _ in pairs])
    return dict(pairs)


def _check_once(keys: list[str]) -> None:
    if len(set(keys)) < len(keys):
        raise ParseError(
            f"{show_value(next(key for key, count in Counter(keys).items() if count > 1))} is given"
            " twice"
        )


class _Loader(yaml.SafeLoader):
    """Plain YAML in which no mapping has a key twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        _check_once([k.value for k, _ in node.value if isinstance(k, yaml.ScalarNode)])
        return super().construct_mapping(node, deep)


def _number(
    construct: Callable[[yaml.SafeLoader, yaml.ScalarNode], Any],
) -> Callable[[yaml.SafeLoader, yaml.ScalarNode], Any]:
    """A number of YAML 1.1, in which 1:30 would be 90 and 1_0 would be 10; here these are texts."""
    return lambda loader, node: (
        construct(loader, node) if {":", "_"}.isdisjoint(node.value) else node.value
    )


_Loader.add_constructor("tag:yaml.org,2002:int", _number(yaml.SafeLoader.construct_yaml_int))
_Loader.add_constructor("tag:yaml.org,2002:float", _number(yaml.SafeLoader.construct_yaml_float))

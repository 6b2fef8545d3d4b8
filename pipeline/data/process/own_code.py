"""A user's code: its place and errors."""

import inspect
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.data.errors import DominoError

PACKAGE = Path(__file__).parents[1]
_INSTALLED = "site-packages"


class OwnCodeError(DominoError):
    """An error in an extension; the message begins with FILE:LINE."""


def is_outside(cls: type) -> bool:
    """Whether a class is defined outside the package."""
    return not cls.__module__.startswith("pipeline.")


def file_of(cls: type) -> str | None:
    """The file that defines a class."""
    return getattr(sys.modules.get(cls.__module__), "__file__", None)


def line_of_class(cls: type, name: str = "") -> str:
    """FILE:LINE of a class, or of an attribute in it; its module if it has no source."""
    try:
        lines, first = inspect.getsourcelines(cls)
    except (OSError, TypeError):
        return cls.__module__
    words = (line.replace(":", " ").replace("(", " ").replace(",", " ").split() for line in lines)
    at = next((i for i, found in enumerate(words) if name and name in found[:2]), 0)
    return f"{inspect.getsourcefile(cls)}:{first + at}"


def line_of_error(error: BaseException, file: str | None) -> str:
    """FILE:LINE of the last line in or beside `file` that led to an error, "" if none did."""
    if file is None:
        return ""
    root = Path(file) if Path(file).parent.name == _INSTALLED else Path(file).parent
    found = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        if _is_own(frame.f_code.co_filename, root):
            found = f"{frame.f_code.co_filename}:{line}"
        for waiting in filter(inspect.isgenerator, frame.f_locals.values()):
            if waiting.gi_frame is not None and _is_own(waiting.gi_code.co_filename, root):
                found = f"{waiting.gi_code.co_filename}:{waiting.gi_frame.f_lineno}"
    if isinstance(error, SyntaxError) and error.filename and error.lineno:
        return f"{error.filename}:{error.lineno}"
    return found


def _is_own(text: str, root: Path) -> bool:
    path = Path(text)
    inside = path.is_relative_to(root) and _INSTALLED not in path.relative_to(root).parts
    return inside and (not path.is_relative_to(PACKAGE) or root.is_relative_to(PACKAGE))


def describe_error(error: BaseException) -> str:
    """Type and message of an error in one line, with Python's suggestion."""
    said = traceback.TracebackException.from_exception(error, lookup_lines=False)
    return " ".join(f"{type(error).__name__}: {said}".split())


def raise_own(error: Exception, cls: type, what: str) -> None:
    """Raise OwnCodeError for an outside class's error, unless a DominoError."""
    if is_outside(cls) and not isinstance(error, DominoError):
        place = line_of_error(error, file_of(cls)) or line_of_class(cls)
        raise OwnCodeError(f"{place}: {what}: {describe_error(error)}") from error


@dataclass(frozen=True)
class Finding:
    """Whether a clause of a contract holds, and what was seen."""

    name: str
    ok: bool
    detail: str


def catch_errors(
    name: str, author: type, check: Callable[[], Iterable[Finding]]
) -> Iterator[Finding]:
    """Findings of a check; an error is one, with the author's line."""
    try:
        yield from check()
    except DominoError as error:
        yield Finding(name, False, str(error))
    except Exception as error:  # noqa: BLE001 (whatever foreign code raises)
        place = line_of_error(error, file_of(author)) or line_of_class(author)
        yield Finding(name, False, f"{place}: {describe_error(error)}")

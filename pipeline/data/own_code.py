"""Where a user's own code is, and where in it an error comes from: extensions are named by file and
line."""

import inspect
import os
import sys
import traceback
from pathlib import Path

from pipeline.data.errors import DominoError

PACKAGE = Path(__file__).parents[1]
_INSTALLED = "site-packages"

ENV = "DOMINO_PLUGINS"
"""The environment variable that names directories of extensions."""


class OwnCodeError(DominoError):
    """An error in an extension from outside the package; the message begins with FILE:LINE."""


def directories() -> list[Path]:
    """The directories of DOMINO_PLUGINS."""
    return [Path(part).resolve() for part in os.environ.get(ENV, "").split(os.pathsep) if part]


def is_outside(cls: type) -> bool:
    """Whether a class is defined outside the package."""
    return not cls.__module__.startswith("pipeline.")


def file_of(cls: type) -> str | None:
    """The file that defines a class, None if it has none."""
    return getattr(sys.modules.get(cls.__module__), "__file__", None)


def line_of_class(cls: type, name: str = "") -> str:
    """FILE:LINE at which a class is defined, or at which its body names an attribute; its module if
    it has no source text."""
    try:
        lines, first = inspect.getsourcelines(cls)
    except (OSError, TypeError):
        return cls.__module__
    words = (line.replace(":", " ").replace("(", " ").replace(",", " ").split() for line in lines)
    at = next((i for i, found in enumerate(words) if name and name in found[:2]), 0)
    return f"{inspect.getsourcefile(cls)}:{first + at}"


def line_of_error(error: BaseException, file: str | None) -> str:
    """FILE:LINE of the last line in `file`, or in a file beside it, that led to an error; "" if
    none did.

    A generator of such a file that waits while the package works on what it yielded counts as well.
    """
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
    """The type and the message of an error in one line, with the name that Python proposes for one
    that does not exist."""
    said = traceback.TracebackException.from_exception(error, lookup_lines=False)
    return " ".join(f"{type(error).__name__}: {said}".split())


def raise_own(error: Exception, cls: type, what: str) -> None:
    """Raise OwnCodeError for an error that the code of `cls` caused, if this class is from outside
    the package.

    The line is that of the error, or that of the class if the error passed no line of its file.
    DominoErrors stay as they are.
    """
    if is_outside(cls) and not isinstance(error, DominoError):
        place = line_of_error(error, file_of(cls)) or line_of_class(cls)
        raise OwnCodeError(f"{place}: {what}: {describe_error(error)}") from error

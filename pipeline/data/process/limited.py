"""Runs a function on files or code of others in a child process of limited memory and time."""

import importlib
import os
import pickle
import resource
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from pipeline.data.errors import DominoError

START = (
    "import sys; sys.path[:] = {path!r}; from pipeline.data.process.limited import answer;"
    " answer({fd})"
)


STARVED = ("SIGKILL", "SIGABRT", "SIGSEGV", "SIGBUS")  # ends of a process that gets no memory


class LimitError(DominoError):
    """Work that did not end within its limits, or ended its process."""


@dataclass(frozen=True)
class Limits:
    """A child's limits: bytes beyond its imports, s of processor and wall time, bytes a file."""

    memory: int = 3 << 30
    processor: int = 600
    wall: float = 1800.0
    file: int = 1 << 30


USUAL = Limits()


def run_limited[T](
    what: str, function: Callable[..., T], *arguments: Any, limits: Limits = USUAL
) -> T:
    """The value of a module's function for picklable arguments. Raises DominoError for its
    errors, LimitError for any other end.
    """
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as found:
        for part in (limits, (_module_of(function), function.__name__, arguments)):
            pickle.dump(part, given)
        given.seek(0)
        start = START.format(path=sys.path, fd=found.fileno())
        child = subprocess.Popen(
            [sys.executable, "-P", "-c", start],
            stdin=given,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(found.fileno(),),
            start_new_session=True,
        )
        try:
            code = child.wait(limits.wall)
        except subprocess.TimeoutExpired:
            raise LimitError(f"{what}: takes longer than {limits.wall:g} s") from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
        found.seek(0)
        data = found.read()
    if code != 0 or not data:
        raise LimitError(f"{what}: {_cause(code, limits)}")
    value, line, details = pickle.loads(data)
    if line is None:
        return value
    if details is None:
        raise DominoError(line)
    raise LimitError(f"{what}: {line}") from RuntimeError(details)


def _module_of(function: Callable[..., object]) -> str:
    spec = getattr(sys.modules.get("__main__"), "__spec__", None)
    return spec.name if function.__module__ == "__main__" and spec else function.__module__


def _cause(code: int, limits: Limits) -> str:
    if code == -signal.SIGXCPU:
        return f"takes more than {limits.processor} s of processor time"
    if code < 0:
        name = signal.Signals(-code).name
        hint = f"; it may need more than {limits.memory >> 20} MiB of memory"
        return f"ended its process by {name}{hint if name in STARVED else ''}"
    return f"ended its process with exit code {code}"


def answer(fd: int) -> None:
    """The child's side: write the value or the error to a file."""
    limits = pickle.load(sys.stdin.buffer)
    resource.setrlimit(resource.RLIMIT_CPU, (limits.processor, limits.processor + 5))
    resource.setrlimit(resource.RLIMIT_FSIZE, (limits.file, limits.file))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    most = resource.getrlimit(resource.RLIMIT_DATA)[1]
    value, line, details = None, None, None
    try:
        module, name, arguments = pickle.load(sys.stdin.buffer)
        function = getattr(importlib.import_module(module), name)
        with open("/proc/self/statm") as file:
            loaded = int(file.read().split()[5]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_DATA, (loaded + limits.memory, most))
        value = function(*arguments)
    except DominoError as error:
        line = "; ".join([str(error), *getattr(error, "__notes__", ())])
    except BaseException as error:  # noqa: BLE001 code of others may raise anything
        details = traceback.format_exc()
        line = " ".join(f"raised {type(error).__name__}: {error}".split())[:300]
        if isinstance(error, MemoryError):
            line = f"needs more than {limits.memory >> 20} MiB of memory"
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    with open(fd, "wb") as file:
        pickle.dump((value, line, details), file)
    os._exit(0)

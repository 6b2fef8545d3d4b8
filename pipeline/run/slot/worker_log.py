"""A process's output for one slot, kept if the slot fails."""

import faulthandler
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path


class Log:
    """A log that is being written; it is removed in the end unless it is to be kept."""

    keep = False


@contextmanager
def worker_log(path: Path) -> Iterator[Log]:
    """Append standard output, error and tracebacks (also of fatal signals) to a file. Raises
    OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    log = Log()
    with open(path, "a", encoding="utf-8", buffering=1) as file:
        _flush()
        kept = [(number, os.dup(number)) for number in (1, 2)]
        crashes = faulthandler.is_enabled()
        faulthandler.enable(file)
        try:
            for number, _ in kept:
                os.dup2(file.fileno(), number)
            # Ray's workers print to files that are not the process's own
            with redirect_stdout(file), redirect_stderr(file):
                yield log
        except Exception as error:
            log.keep = True
            traceback.print_exc(file=file)
            error.add_note(f"log of its worker: {path}")
            raise
        finally:
            _flush()
            for number, copy in kept:
                os.dup2(copy, number)
                os.close(copy)
            faulthandler.disable()
            if crashes and sys.__stderr__ is not None:
                faulthandler.enable(sys.__stderr__)
    if not log.keep:
        path.unlink(missing_ok=True)
        with suppress(OSError):  # other slots have logs there
            path.parent.rmdir()


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        stream.flush()

"""A time limit for code of a user: what it does in a loop without an end, this process cannot
know."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


class _Alarm(BaseException):
    """Interrupts foreign code; no `except Exception` of its own stops it."""


@contextmanager
def time_limit(seconds: float, late: Exception) -> Iterator[None]:
    """Raises `late` for a block that takes longer, from what the block was doing.

    In the main thread the block is interrupted, where it waits or between two of its Python
    instructions. Elsewhere, and in native code, the error is raised when the block ends.
    """
    began, in_main = time.monotonic(), threading.current_thread() is threading.main_thread()

    def interrupt(_signal: int, _frame: FrameType | None) -> None:
        raise _Alarm

    before: Any = None
    if in_main:
        before = signal.signal(signal.SIGALRM, interrupt)
        # again every second, should the code catch it
        signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        try:
            yield
        finally:
            if in_main:
                signal.setitimer(signal.ITIMER_REAL, 0)
    except _Alarm as alarm:
        raise late.with_traceback(alarm.__traceback__) from None
    finally:
        if in_main:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
    if time.monotonic() - began > seconds:
        raise late

"""SIGINT and SIGTERM: a clean stop, from the main thread only."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_CLEANUP_SECONDS = 10.0


class Stopped(KeyboardInterrupt):
    """The user asked to stop (Ctrl-C or SIGTERM); everything finished so far is on disk."""


@contextmanager
def stop_on_signal() -> Iterator[None]:
    """SIGINT and SIGTERM raise Stopped; further ones are ignored for ten seconds."""
    last = float("-inf")

    def stop(_signal: int, _frame: FrameType | None) -> None:
        nonlocal last
        if time.monotonic() - last > _CLEANUP_SECONDS:
            last = time.monotonic()
            raise Stopped

    try:
        with _handled_by(stop):
            yield
    except KeyboardInterrupt as interrupt:
        # Ray raises one of its own if a handler raises while it waits
        raise Stopped from interrupt


@contextmanager
def hold_signals() -> Iterator[None]:
    """Delay signals to the block's end; restores replaced handlers."""
    arrived: list[int] = []
    try:
        with _handled_by(lambda number, _: arrived.append(number)):
            yield
    finally:
        for number in arrived[:1]:
            signal.raise_signal(number)


@contextmanager
def _handled_by(handler: Any) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in _STOP_SIGNALS}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)

"""SIGINT and SIGTERM: a clean stop, once, and never in the middle of what must not be cut short."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_MOMENT = 0.01  # s


class Stopped(KeyboardInterrupt):
    """The user asked to stop (Ctrl-C or SIGTERM); everything finished so far is on disk."""


@contextmanager
def stop_on_signal() -> Iterator[None]:
    """Within, the first SIGINT or SIGTERM raises Stopped; later ones are ignored, so that cleaning up is not cut short.

    Where Python drops the exception, because it was raised in the callback of a weak reference or a finalizer, it is sent again.
    """
    asked = False
    dropped = sys.unraisablehook

    def stop(_signal: int, _frame: FrameType | None) -> None:
        nonlocal asked
        if not asked:
            asked = True
            raise Stopped

    def again(unraisable: "sys.UnraisableHookArgs") -> None:
        nonlocal asked
        if not isinstance(unraisable.exc_value, Stopped):
            dropped(unraisable)
            return
        asked = False
        # a moment later, when the callback has been left; to the thread of the handlers, which a wait must not keep from it
        threading.Timer(_MOMENT, signal.pthread_kill, [threading.main_thread().ident, signal.SIGINT]).start()

    found = {number: signal.signal(number, stop) for number in STOP_SIGNALS}
    sys.unraisablehook = again
    try:
        yield
    except KeyboardInterrupt as interrupt:
        # Ray raises one of its own where a handler raised while it waited
        raise Stopped from interrupt
    finally:
        sys.unraisablehook = dropped
        for number, handler in found.items():
            signal.signal(number, handler)


@contextmanager
def defer_signals() -> Iterator[None]:
    """SIGINT and SIGTERM that arrive within take effect at its end; handlers that the block replaces are put back.

    While it starts, Ray replaces the operating system's handler of SIGTERM, behind Python's back, by one that aborts;
    `signal.signal` sets both again.
    """
    found = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    arrived: list[int] = []
    for number in STOP_SIGNALS:
        signal.signal(number, lambda number, _: arrived.append(number))
    try:
        yield
    finally:
        for number, handler in found.items():
            signal.signal(number, handler)
        for number in arrived[:1]:
            signal.raise_signal(number)

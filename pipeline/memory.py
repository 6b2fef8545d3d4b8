"""Memory that a process need not hold or look at."""

import ctypes
import gc
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache


@contextmanager
def freeze_garbage() -> Generator[None]:
    """Take what exists out of garbage collection for a while.

    Python collects everything only when a quarter as many new objects as old ones have stayed, and
    looks at the old ones too each time. The imports leave a million: behind them the garbage of ten
    attempts would wait, 200 MB, and exports would be slower.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def trim() -> None:
    """Give the free pages of the C heap back to the system, where the C library can (glibc).

    By itself it keeps what lies below the newest allocation: after 200 slots that would be a fifth
    of a worker's memory.
    """
    if hasattr(library := _c_library(), "malloc_trim"):
        library.malloc_trim(0)


@cache
def _c_library() -> ctypes.CDLL:
    return ctypes.CDLL(None)

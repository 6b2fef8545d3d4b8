"""Memory that a process need not hold or look at."""

import ctypes
import gc
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def freeze_garbage() -> Generator[None]:
    """Take what exists out of garbage collection for a while: behind the million objects of the
    imports the garbage of ten attempts would wait, 200 MB."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def trim() -> None:
    """Give the free pages of the C heap back to the system: a fifth of memory after 200 slots."""
    if hasattr(library := ctypes.CDLL(None), "malloc_trim"):
        library.malloc_trim(0)

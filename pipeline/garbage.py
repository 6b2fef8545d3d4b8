"""Objects that stay, taken out of garbage collection.

Python collects everything only when a quarter as many new objects as old ones have stayed, and looks at the old ones too each time.
The imports leave a million: behind them the garbage of ten attempts would wait, 200 MB, and an export be a twentieth slower.
"""

import gc
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def settled() -> Generator[None]:
    """Take what exists out of garbage collection for a while."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()

"""What of this machine a process may use, and the memory that it need not hold or look at."""

import ctypes
import gc
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

CACHE = "DOMINO_DATA_CACHE"  # environment variable: the cache directory
PLUGINS = "DOMINO_PLUGINS"  # environment variable: directories of extensions


def usable_cores() -> int:
    """Cores that this process may run on; all on macOS."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def user_cache(name: str) -> Path | None:
    """$DOMINO_DATA_CACHE/<name> or domino-data/<name> in the user's cache; None without a home."""
    if chosen := os.environ.get(CACHE):
        return Path(chosen).absolute() / name
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        return None
    return home.absolute() / "domino-data" / name


def directories() -> list[Path]:
    """Those of DOMINO_PLUGINS."""
    return [Path(part).resolve() for part in os.environ.get(PLUGINS, "").split(os.pathsep) if part]


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

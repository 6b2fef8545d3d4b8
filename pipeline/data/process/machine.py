"""What of this machine a process may use."""

import os
from pathlib import Path

CACHE = "DOMINO_DATA_CACHE"  # environment variable: the cache directory


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

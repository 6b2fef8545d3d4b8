"""What of this machine a process may use: cores, and a directory for what can be made again."""

import os
from pathlib import Path

CACHE = "DOMINO_DATA_CACHE"
"""Environment variable: the cache directory, if not domino-data below the user's cache."""


def usable_cores() -> int:
    """How many cores this process may run on; all of the machine on macOS, which keeps no list."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def user_cache(name: str) -> Path | None:
    """$DOMINO_DATA_CACHE/<name>, else that below domino-data in the user's cache; None without a
    home."""
    if chosen := os.environ.get(CACHE):
        return Path(chosen).absolute() / name
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        return None
    return home.absolute() / "domino-data" / name

"""Where things are kept that can be made again, for the user of this machine."""

import os
from pathlib import Path

CACHE = "DOMINO_DATA_CACHE"
"""Environment variable: the directory, where it is to be another one than domino-data below the
user's cache."""


def user_cache(name: str) -> Path | None:
    """The directory $DOMINO_DATA_CACHE/<name>; where that is not set
    $XDG_CACHE_HOME/domino-data/<name>, or below ~/.cache.

    None for a user without a home.
    """
    if chosen := os.environ.get(CACHE):
        return Path(chosen).absolute() / name
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        return None
    return home.absolute() / "domino-data" / name

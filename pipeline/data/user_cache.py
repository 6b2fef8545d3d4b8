"""Where things are kept that can be made again, for the user of this machine."""

import os
from pathlib import Path


def user_cache(name: str) -> Path | None:
    """The directory $XDG_CACHE_HOME/domino-data/<name>, below ~/.cache where that is not set; None for a user without a home."""
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        return None
    return home / "domino-data" / name

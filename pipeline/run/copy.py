"""`domino-data pull` and `push`: files between a URL and a directory of this machine."""

import re
from pathlib import Path

from pipeline.data.store.files import StoreError
from pipeline.data.store.place import SMALL, Place


def pull(url: str, folder: Path) -> tuple[int, int]:
    """Fetch what differs below a URL: how many files there are, and were fetched. Raises
    StoreError.
    """
    place = Place(folder, url)
    if not (paths := place.files(".*")):
        raise StoreError(f"{url}: there is nothing: name the URL of a dataset or an export")
    new = [path for path in paths if _differs(place, path)]
    place.pull(new)
    return len(paths), len(new)


def push(folder: Path, url: str) -> tuple[int, int]:
    """Put the files that differ below a URL: how many there are, and were put. Raises
    StoreError, Busy.
    """
    place = Place(folder, url)
    with place.store.hold():
        paths = [path for path in folder.rglob("*") if path.is_file()]
        new = [path for path in paths if _differs(place, path)]
        place.put(new)
    return len(paths), len(new)


def _differs(place: Place, path: Path) -> bool:
    """Whether its length is not that of its object, or it is one of the few that change."""
    same = path.is_file() and path.stat().st_size == place.size(path)
    return not same or re.fullmatch(SMALL, place.name(path)) is not None

"""Where the mirrors of a URL (mirror.py) lie on this machine: one is taken by one command at a
time, and they can be removed."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from urllib.parse import quote

from pipeline.data.atomic import remove
from pipeline.data.store.files import StoreError
from pipeline.data.store.lock import Busy
from pipeline.data.store.urls import mirrors

_LONGEST = 240  # bytes; names of files have at most 255


@dataclass(frozen=True)
class Place:
    """A mirror of a URL: its directory, and the bytes that it takes on the disk."""

    path: str
    size: int


@contextmanager
def free_place(url: str) -> Iterator[Path]:
    """The first mirror of a URL that no other command uses; one in which nothing is at the end is
    removed. Raises StoreError."""
    first = _first(url)
    first.parent.mkdir(parents=True, exist_ok=True)
    for number in count():
        root = first.with_name(f"{first.name}~{number}") if number else first
        with _lock(root) as mine:
            if mine:
                yield root
                return


def forget(url: str, dry_run: bool = False) -> list[Place]:
    """Remove, or only list, the mirrors of a URL on this machine. What is on the store stays, and
    is not asked.

    Raises Busy if a command uses one of them, StoreError, OSError.
    """
    first, found = _first(url), list[Place]()
    # quoted, a URL has none of the signs that a pattern is made of
    others = (
        path for path in first.parent.glob(f"{first.name}~*") if not path.name.endswith(".lock")
    )
    for root in filter(Path.is_dir, (first, *sorted(others))):
        with _lock(root) as mine:
            if not mine:
                raise Busy(
                    f"{url}: another command on this machine is at work on it: wait until that has"
                    " ended, or stop it"
                )
            found.append(Place(str(root), _size(root)))
            if not dry_run:
                remove(root)
    return found


@contextmanager
def _lock(root: Path) -> Iterator[bool]:
    """Whether this command alone may use a mirror until the block ends. One that is then empty is
    removed."""
    path = root.with_name(f"{root.name}.lock")
    with open(path, "ab") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
            return
        # whoever had it may have removed it meanwhile, and another one made it anew
        if not path.exists() or not os.path.samestat(os.fstat(lock.fileno()), path.stat()):
            yield False
            return
        try:
            yield True
        finally:
            if not any(names for _, _, names in os.walk(root)):
                remove(root)
                path.unlink(missing_ok=True)


def _first(url: str) -> Path:
    name = quote(url, safe="")
    if len(name) > _LONGEST:
        raise StoreError(f"{url}: is too long to be a dataset's URL: name a shorter one")
    return mirrors() / name


def _size(root: Path) -> int:
    """Bytes on the disk: files that are listed only take none."""
    return sum(
        os.lstat(os.path.join(folder, name)).st_blocks * 512
        for folder, _, names in os.walk(root)
        for name in names
    )

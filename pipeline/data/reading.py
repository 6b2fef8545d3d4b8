"""Reads files of a dataset directory, safely."""

import errno
import os
import stat
from contextlib import suppress
from io import BufferedReader
from pathlib import Path

from .store.place import place_of

LARGEST = 1 << 28  # bytes of a file that is parsed whole, at most
IRREGULAR = "is no regular file; remove it"


def check_regular(path: Path) -> None:
    """Raise OSError for a path that is no regular file. Fetches a missing file from its store.
    Raises StoreError.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        if not ((place := place_of(path)) and place.fetch(path)):
            raise
        mode = os.stat(path).st_mode
    if not stat.S_ISREG(mode):
        raise OSError(errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL, IRREGULAR, str(path))


def open_regular(path: Path) -> BufferedReader:
    """A regular file, opened for bytes. Raises OSError for what is none."""
    check_regular(path)
    return open(path, "rb")


def read_regular(path: Path, most: int = LARGEST) -> bytes:
    """A regular file's bytes. Raises OSError for any other, or above `most` bytes."""
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > most:
            raise OSError(errno.E2BIG, f"has more than {most} bytes", str(path))
        return file.read()


def check_tree(root: Path) -> None:
    """Raise OSError for a link, pipe, socket or device anywhere below a directory."""
    waiting = [os.fspath(root)]
    while waiting:
        with suppress(FileNotFoundError):
            waiting += check_plain(waiting.pop())


def check_plain(directory: str | Path) -> list[str]:
    """The directories in one. Raises OSError for special files."""
    found = list[str]()
    with os.scandir(directory) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                found.append(entry.path)
            elif not entry.is_file(follow_symlinks=False):
                kind = "a link" if entry.is_symlink() else "no plain file"
                what = f"is {kind}, which does not belong there; remove it"
                raise OSError(errno.EINVAL, what, entry.path)
    return found


def printable(text: str) -> str:
    """A text in which what a terminal would obey or cannot show is escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text
    )

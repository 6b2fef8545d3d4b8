"""Reading what a dataset directory holds, where anything may stand in place of a file and anything
may stand in it."""

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path

from pipeline.data.store.place import place_of

IRREGULAR = "is no regular file; remove it"
"""What is said of a directory, pipe, socket or device in place of a file."""


def check_regular(path: Path) -> None:
    """Raise OSError for a path that is there and is no regular file, so that nothing waits for a
    pipe or reads a device.

    A file that is not there is fetched from the store that holds its dataset, if any. Raises
    StoreError.
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
    """A regular file, opened for reading bytes. Raises OSError for what is none."""
    check_regular(path)
    return open(path, "rb")


def read_regular(path: Path) -> bytes:
    """The bytes of a regular file. Raises OSError for what is none."""
    with open_regular(path) as file:
        return file.read()


def printable(text: str) -> str:
    """A text with the names of files in it, in which what a terminal would obey or cannot show is
    escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text
    )

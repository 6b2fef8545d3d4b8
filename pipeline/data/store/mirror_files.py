"""The files of a mirror (mirror.py): written here, the same as an object, or listed only."""

import hashlib
import os
import stat
from pathlib import Path

from pipeline.data.atomic import remove
from pipeline.data.store.files import Listed

LISTED = stat.S_IWUSR
"""Permissions of a file without its bytes."""

_YEARS = 9 * 10**17  # ns: until 1998


def mark(listed: Listed) -> int:
    """Time of change (ns) of a file that is the same as an object: a number that is made from the
    object's identity."""
    return int(hashlib.sha256(listed.identity.encode()).hexdigest()[:15], 16) % _YEARS


def is_listed(path: Path) -> bool:
    """Whether a file of a mirror is listed only."""
    try:
        return stat.S_IMODE(path.stat().st_mode) == LISTED
    except FileNotFoundError:
        return False


def is_new(path: Path) -> bool:
    """Whether a file was written here since it was last the same as its object."""
    try:
        state = path.stat()
    except FileNotFoundError:
        return False
    return stat.S_ISREG(state.st_mode) and state.st_mtime_ns >= _YEARS


def state_of(path: Path) -> tuple[int, int] | None:
    """Length and time of change (ns) of a regular file, None for what is none."""
    try:
        state = path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    return (state.st_size, state.st_mtime_ns) if stat.S_ISREG(state.st_mode) else None


def list_only(path: Path, size: int, time: int) -> None:
    """Put a file without bytes at a path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if os.path.lexists(path):
        remove(path)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, LISTED)
    try:
        os.ftruncate(descriptor, size)
        os.fchmod(descriptor, LISTED)
        os.utime(descriptor, ns=(time, time))
    finally:
        os.close(descriptor)

"""Errors of users and systems, in one line."""

import errno
import os
from pathlib import Path


class DominoError(Exception):
    """Bad input or a damaged file: one line with the thing and the fix (exit code 2)."""


DAMAGE = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError),
    *(OSError, RuntimeError, TypeError, ValueError),
)
"""What a damaged file may make h5py, numpy and our readers raise."""

_KEPT = "finished work is kept; rerun the same command to resume"
FIXES = {
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some space or raise the quota",
    errno.EACCES: "give this user the permission",
    errno.EPERM: "give this user the permission",
    errno.EROFS: "make it writable",
    errno.EFBIG: "raise the limit of file sizes (ulimit -f)",
    **dict.fromkeys(
        (errno.EIO, errno.ESTALE, errno.ENOTCONN), "the mount is gone or broken: mount it again"
    ),
}


def describe_error(error: OSError) -> str:
    """The file, what is wrong with it, and the fix if there is one."""
    where = f"{error.filename}: " if error.filename else ""
    return where + refusal(error) + (f"; {_KEPT}" if error.errno in FIXES else "")


def refusal(error: OSError) -> str:
    """What the system refused, in its words, and the fix if there is one."""
    if fix := FIXES.get(error.errno or 0):
        return f"{os.strerror(error.errno or 0)}: {fix}"
    return one_line(error.strerror or error)


def one_line(error: object, most: int = 200) -> str:
    """An error's message on one line, or its type if it has none."""
    return " ".join(str(error).split())[:most] or type(error).__name__


def check_directory(path: Path) -> None:
    """Raise OSError if a file is at the path or above it."""
    there = next(each for each in (path, *path.absolute().parents) if os.path.lexists(each))
    if not there.is_dir():
        raise OSError(errno.ENOTDIR, "is no directory; name another path", str(there))

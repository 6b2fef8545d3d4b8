"""One command at a time writes a dataset: its index has a single writer."""

import errno
import fcntl
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.data.errors import DominoError

_UNABLE = (errno.EBADF, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
"""What file systems say that cannot lock a directory, as NFS."""


class Busy(DominoError):
    """Another command is at work in a dataset."""


@contextmanager
def exclusive(directory: Path) -> Iterator[None]:
    """Hold the lock of an existing directory, which ends with the process however it ends, and
    leaves no file.

    Raises Busy if another process, or another call in this one, holds it. Where the file system
    has no such locks, it holds nothing and prints one line.
    """
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise Busy(
                f"{directory}: another command is writing it: wait until that has ended, or stop it"
            ) from error
        except OSError as error:
            if error.errno not in _UNABLE:
                raise
            print(
                f"domino-data: warning: {directory} cannot be locked here ({error.strerror}): let"
                " one command at a time write it",
                file=sys.stderr,
            )
        yield
    finally:
        os.close(descriptor)

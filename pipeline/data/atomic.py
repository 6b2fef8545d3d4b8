"""Files and directories that are whole or missing: written as `.<name>.<host>.<process id>.tmp`,
then renamed.
"""

import errno
import fcntl
import os
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import DominoError


def temporary_name(path: Path) -> Path:
    """The name beside `path` under which this process writes it."""
    return path.with_name(f".{path.name}.{socket.gethostname()}.{os.getpid()}.tmp")


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path that becomes `path` unless the block fails. Its directory is made. Raises
    OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_name(path)
    try:
        yield temporary
        with open(temporary, "rb") as done:
            os.fsync(done.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_directory(path: Path) -> Iterator[Path]:
    """A temporary directory, which becomes `path` when the block ends without an error, else
    vanishes. Raises OSError.
    """
    old = path.with_name(f".{path.name}.old")
    made = not path.parent.exists()
    path.parent.mkdir(parents=True, exist_ok=True)
    if old.exists() and not path.exists():
        os.rename(old, path)
    temporary = temporary_name(path)
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    try:
        yield temporary
        shutil.rmtree(old, ignore_errors=True)
        if path.exists():
            os.rename(path, old)
        os.rename(temporary, path)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        if made:
            with suppress(OSError):  # it is not empty, unless the block failed
                path.parent.rmdir()


def write_atomic(path: Path, data: bytes) -> None:
    """Write a small file whole or not at all. Raises OSError."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def link(path: Path, to: Path) -> None:
    """Make `to` a hard link of `path`, or an atomic copy with its time. Raises OSError."""
    if to.exists() and (os.path.samefile(path, to) or file_state(path) == file_state(to)):
        return
    with atomic_path(to) as temporary:
        temporary.unlink(missing_ok=True)
        try:
            os.link(path, temporary)
        except OSError:  # another file system, or one without hard links
            shutil.copy2(path, temporary)


def file_state(path: Path) -> tuple[int, int]:
    """Length (bytes) and time of change (ns) of a file."""
    state = path.stat()
    return state.st_size, state.st_mtime_ns


def remove(path: Path) -> None:
    """Remove a file, a link, or a directory with all that it holds, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def sweep(directory: Path, pattern: str = "**/.*.tmp") -> int:
    """Delete temporary files of dead local processes; returns how many."""
    host, gone = socket.gethostname(), 0
    for left in sorted(directory.glob(pattern)):
        name, _, process = left.name.removesuffix(".tmp").rpartition(".")
        if name.endswith(f".{host}") and process.isdecimal() and not _lives(process):
            with suppress(OSError):
                remove(left)
                gone += 1
    return gone


def _lives(process: str) -> bool:
    try:
        return Path("/proc", process, "stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


_UNABLE = (errno.EBADF, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # of NFS and its like


class Busy(DominoError):
    """Another command is at work in a dataset."""


@contextmanager
def exclusive(directory: Path) -> Iterator[None]:
    """Hold the lock of a directory; it ends with the process. Raises Busy. A file system without
    locks holds nothing.
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

"""Run as a program beside a driver: when the driver ends, however it ends, kill its Ray helpers and remove their directory.

    python guard.py DIRECTORY DESCRIPTOR...

Descriptors are process file descriptors (pidfd_open) that were passed on. The kernel and Ray end nearly everything with a driver
that is killed, but Ray's agents only after a minute, and nobody removes the directory. Imports nothing but the standard library.
"""

import os
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_SECONDS = 5.0


@contextmanager
def guard_directory(folder: Path, parent: str) -> Iterator[None]:
    """A guard for a directory and for the children, as they are now, of that child of this process whose name is `parent`."""
    grandchildren = [pid for child in find_children(os.getpid(), parent) for pid in _children(child)]
    descriptors = [os.pidfd_open(pid) for pid in grandchildren]
    command = [sys.executable, "-IS", __file__, str(folder), *map(str, descriptors)]
    # a session of its own, so that Ctrl-C does not reach it
    guard = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=descriptors, start_new_session=True)
    for descriptor in descriptors:
        os.close(descriptor)
    try:
        yield
    finally:
        guard.communicate()


def find_children(pid: int, name: str) -> list[int]:
    """The children of a process that have this name."""
    return [child for child in _children(pid) if _name(child) == name]


def _children(pid: int) -> list[int]:
    return [int(child) for file in Path(f"/proc/{pid}/task").glob("*/children") for child in file.read_text().split()]


def _name(pid: int) -> str:
    return Path(f"/proc/{pid}/comm").read_text().strip()


def main(folder: str, *descriptors: str) -> None:
    """Wait for the driver to end, then clear up."""
    sys.stdin.read()
    processes = select.poll()
    for descriptor in map(int, descriptors):
        processes.register(descriptor, select.POLLIN)
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(descriptor, signal.SIGKILL)
    deadline = time.monotonic() + _SECONDS
    left = len(descriptors)
    while left and time.monotonic() < deadline:
        for descriptor, _ in processes.poll(100):
            processes.unregister(descriptor)
            left -= 1
    # a process that is just ending may still write a last line
    while os.path.exists(folder) and time.monotonic() < deadline:
        shutil.rmtree(folder, ignore_errors=True)
        time.sleep(0.05)


if __name__ == "__main__":
    main(*sys.argv[1:])

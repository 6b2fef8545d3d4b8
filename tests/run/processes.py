"""What runs on this machine and listens, read from /proc."""

import os
import socket
import time
from collections.abc import Callable
from pathlib import Path


def wait_for[T](found: Callable[[], T], seconds: float = 60.0, every: float = 0.05) -> T:
    """What `found` returns once that is true; fails after so many seconds."""
    deadline = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < deadline, f"waited {seconds} s"
        time.sleep(every)
    return value


def parents() -> dict[int, tuple[int, int]]:
    """Parent and session of every living process."""
    out = {}
    for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):
        try:
            state, parent, _, session = (
                Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[:4]
            )
        except OSError:
            continue
        if state != "Z":
            out[pid] = int(parent), int(session)
    return out


def of_session(session: int) -> list[int]:
    """Living processes of a session, which those that a driver starts inherit."""
    return [pid for pid, (_, its) in parents().items() if its == session]


def below(root: int) -> list[int]:
    """A process and its living descendants."""
    found, tree = [root], parents()
    for pid in found:
        found += [child for child, (parent, _) in tree.items() if parent == pid]
    return found


def title(pid: int) -> str:
    """The command line of a process, empty where it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ").strip()
    except OSError:
        return ""


def workers(pids: list[int]) -> list[int]:
    """Those of some processes that are our Ray actors."""
    return [pid for pid in pids if title(pid).startswith("ray::CrewWorker")]


def listening(pids: list[int]) -> set[tuple[str, int]]:
    """Addresses and ports on which processes listen for TCP connections."""
    mine = set()
    for pid in pids:
        try:
            links = [os.readlink(file) for file in Path(f"/proc/{pid}/fd").iterdir()]
        except OSError:
            continue
        mine |= {link[8:-1] for link in links if link.startswith("socket:[")}
    found = set()
    for table, family in (("tcp", socket.AF_INET), ("tcp6", socket.AF_INET6)):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            local, state, inode = (line.split()[i] for i in (1, 3, 9))
            if state == "0A" and inode in mine:
                address, port = local.split(":")
                words = [bytes.fromhex(address[i : i + 8])[::-1] for i in range(0, len(address), 8)]
                found.add((socket.inet_ntop(family, b"".join(words)), int(port, 16)))
    return found


def shared_memory() -> set[str]:
    """Shared memory of Ray object stores that has a name."""
    return {name for name in os.listdir("/dev/shm") if "plasma" in name or "ray" in name}

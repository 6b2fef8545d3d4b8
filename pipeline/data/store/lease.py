"""One command at a time writes a dataset on an object store, which has no locks: an object says who
does, and until when."""

import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pipeline.data.store.files import Store, StoreError
from pipeline.data.store.lock import Busy

LEASE = ".writing.json"
"""The object. It is no file of the dataset."""

SECONDS = 300.0
"""How long a lease lasts that is not renewed; it is renewed five times as often."""


@contextmanager
def hold_lease(store: Store, seconds: float = SECONDS) -> Iterator[threading.Event]:
    """Hold the lease of a store. A process that is killed leaves it behind: the next one on the
    same machine takes it over at once, one on another machine when it has run out. The event is set
    when that has happened to this lease: its machine slept, or the store could not be reached for
    so long.

    Raises Busy if another process holds it, StoreError also for a store that cannot keep two
    commands apart.
    """
    if not store.conditional:
        raise StoreError(
            f"{store.url}: can be read, not written, because two commands could write it at once: "
            "give a directory, s3:// or gs://; `domino-data publish` uploads an export to the hub"
        )
    mine = {
        "host": socket.gethostname(),
        "process": os.getpid(),
        "id": uuid.uuid4().hex,
        "since": time.time(),
    }
    _take(store, mine, seconds)
    ended, lost = threading.Event(), threading.Event()
    keeper = threading.Thread(
        target=_keep, args=(store, _Lease(mine, seconds, lost), ended), daemon=True
    )
    keeper.start()
    try:
        yield lost
    finally:
        ended.set()
        keeper.join()
        with suppress(StoreError):  # it runs out by itself
            if (held := _read_lease(store)) and held.get("id") == mine["id"]:
                store.delete([LEASE])


def _take(store: Store, mine: dict[str, Any], seconds: float) -> None:
    said = _encode_lease(mine, seconds)
    for again in (False, True):
        # asked first, because some servers write over an object whatever the condition
        held = _read_lease(store)
        if held is not None and not _over(held):
            if held.get("id") == mine["id"]:
                return  # the answer to the request was lost
            raise Busy(f"{store.url}: {_whose(held)}")
        if held is not None or again:
            store.delete([LEASE])
        if store.create(LEASE, said):
            return
    raise Busy(
        f"{store.url}: another command has just begun to write it: wait until that has ended, or"
        " stop it"
    )


@dataclass(frozen=True)
class _Lease:
    """Whose lease it is, for how long, and whether it was taken over."""

    mine: dict[str, Any]
    seconds: float
    lost: threading.Event


def _keep(store: Store, lease: _Lease, ended: threading.Event) -> None:
    """Renew the lease until it has ended or is another one's. A store that cannot be reached stops
    the command elsewhere."""
    while not ended.wait(lease.seconds / 5):
        with suppress(StoreError, OSError):
            if (held := _read_lease(store)) and held.get("id") != lease.mine["id"]:
                lease.lost.set()
                return
            store.write(LEASE, _encode_lease(lease.mine, lease.seconds))


def _encode_lease(mine: dict[str, Any], seconds: float) -> bytes:
    now = time.time()
    return json.dumps(mine | {"renewed": now, "until": now + seconds}).encode()


def _whose(held: dict[str, Any]) -> str:
    """The holder of the lease in words: the process, since when, and when the lease lapses if that
    process is dead."""
    now = time.time()
    since, renewed = _clock(held["since"]), max(0, round(now - held["renewed"]))
    lapse = f"at {_clock(held['until'])}, in {max(1, round(held['until'] - now))} s"
    if held["host"] == socket.gethostname():
        lapse = "at once, since it is on this machine"
    who = f"process {held['process']} on {held['host']}, last renewed {renewed} s ago"
    return (
        f"another command is writing it since {since} ({who}): wait until that has ended, or stop"
        f" it; should that process be dead, its lease lapses {lapse}"
    )


def _clock(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _read_lease(store: Store) -> dict[str, Any] | None:
    """The content of the lease; None if there is none or it cannot be read."""
    try:
        values = json.loads(store.read(LEASE) or b"")
        times = {name: float(values[name]) for name in ("since", "renewed", "until")}
        for each in times.values():
            _clock(each)  # refuses what is no time
        return values | times | {"process": int(values["process"]), "host": str(values["host"])}
    except (ValueError, TypeError, KeyError, OverflowError, OSError):
        return None


def _over(held: dict[str, Any]) -> bool:
    """Whether a lease has run out, or its process on this machine is gone."""
    gone = held["host"] == socket.gethostname() and not Path(f"/proc/{held['process']}").exists()
    return gone or held["until"] < time.time()

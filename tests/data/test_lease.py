"""The lease of a store: one writer at a time, also after one was killed."""

import json
import os
import time

import pytest

from pipeline.data.lease import LEASE, leased
from pipeline.data.lock import Busy
from pipeline.data.store import Store


@pytest.fixture
def store(tmp_path):
    return Store(f"memory://{tmp_path.name}/set", pauses=())


def left(store, **said):
    store.write(LEASE, json.dumps({"host": os.uname().nodename, "process": os.getpid(), "id": "x", **said}).encode())


def test_a_second_writer_is_refused_until_the_first_ends(store):
    said = rf"^{store.url}: another command is writing it \(process {os.getpid()} on"
    with leased(store), pytest.raises(Busy, match=said), leased(store):
        pass
    assert store.list() == {}
    with leased(store):
        pass


@pytest.mark.parametrize(
    ("said", "refused"),
    [
        ({"until": 1000}, True),
        ({"until": -1}, False),
        ({"until": 1000, "process": 2**22 + 1}, False),  # no Linux has a process of that number
        ({"until": 1000, "process": 2**22 + 1, "host": "elsewhere"}, True),
        ({"until": "soon"}, False),
    ],
)
def test_what_a_killed_writer_left_holds_only_while_it_may_live(store, said, refused):
    until = said["until"]
    left(store, **said | {"until": until if isinstance(until, str) else time.time() + until})
    if refused:
        with pytest.raises(Busy, match=r"if it was killed, the same command works in \d{3,4} s$"), leased(store):
            pass
    else:
        with leased(store):
            assert json.loads(store.read(LEASE))["id"] != "x"


def test_a_lease_is_renewed_and_one_that_was_taken_over_is_left(store):
    with leased(store, seconds=0.1):
        first = json.loads(store.read(LEASE))["until"]
        time.sleep(0.15)
        assert json.loads(store.read(LEASE))["until"] > first
    with leased(store):
        left(store, until=time.time() + 100)
    assert json.loads(store.read(LEASE))["id"] == "x"


def test_a_lease_of_another_command_is_never_written_over(store):
    with leased(store, seconds=0.1) as lost:
        assert not lost.is_set()
        left(store, until=time.time() + 100)
        assert lost.wait(5)
        time.sleep(0.05)
        assert json.loads(store.read(LEASE))["id"] == "x"
    assert json.loads(store.read(LEASE))["id"] == "x"

"""The lease of a store: one writer at a time, also after one was killed."""

import json
import os
import re
import time

import pytest

from pipeline.data.store.files import Store
from pipeline.data.store.lease import LEASE, hold_lease
from pipeline.data.store.lock import Busy


@pytest.fixture
def store(tmp_path):
    return Store(f"memory://{tmp_path.name}/set", pauses=())


def left(store, **said):
    now = time.time()
    mine = {
        "host": os.uname().nodename,
        "process": os.getpid(),
        "id": "x",
        "since": now,
        "renewed": now,
    }
    store.write(LEASE, json.dumps(mine | said).encode())


TIME = r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC"


def test_a_second_writer_is_refused_until_the_first_ends(store):
    who = rf"process {os.getpid()} on {os.uname().nodename}, last renewed"
    said = rf"^{store.url}: another command is writing it since {TIME} \({who}"
    with hold_lease(store), pytest.raises(Busy, match=said) as refused, hold_lease(store):
        pass
    # a dead process of this machine is seen to be dead
    assert str(refused.value).endswith(
        "should that process be dead, its lease lapses at once, since it is on this machine"
    )
    assert store.list() == {}
    with hold_lease(store):
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
        with (
            pytest.raises(Busy, match="should that process be dead, its lease lapses"),
            hold_lease(store),
        ):
            pass
    else:
        with hold_lease(store):
            assert json.loads(store.read(LEASE))["id"] != "x"


def test_a_writer_elsewhere_is_named_with_its_times(store):
    now = time.time()
    left(store, host="elsewhere", since=now - 7200, renewed=now - 20, until=now + 280)
    with pytest.raises(Busy) as refused, hold_lease(store):
        pass
    since, until = (
        time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(at)) for at in (now - 7200, now + 280)
    )
    said = str(refused.value)
    assert f"since {since} (process {os.getpid()} on elsewhere, last renewed 20 s ago)" in said
    assert re.search(
        rf"should that process be dead, its lease lapses at {until}, in 2\d\d s$", said
    )


@pytest.mark.parametrize("said", [{"until": 1e300}, {"since": "x"}, {"renewed": [1]}])
def test_what_cannot_be_read_is_no_lease(store, said):
    left(store, **{"until": time.time() + 100} | said)
    with hold_lease(store):
        pass


def test_a_lease_is_renewed_and_one_that_was_taken_over_is_left(store):
    with hold_lease(store, seconds=0.1):
        first = json.loads(store.read(LEASE))["until"]
        time.sleep(0.15)
        assert json.loads(store.read(LEASE))["until"] > first
    with hold_lease(store):
        left(store, until=time.time() + 100)
    assert json.loads(store.read(LEASE))["id"] == "x"


def test_a_lease_of_another_command_is_never_written_over(store):
    with hold_lease(store, seconds=0.1) as lost:
        assert not lost.is_set()
        left(store, until=time.time() + 100)
        assert lost.wait(5)
        time.sleep(0.05)
        assert json.loads(store.read(LEASE))["id"] == "x"
    assert json.loads(store.read(LEASE))["id"] == "x"

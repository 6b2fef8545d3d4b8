"""The lease of a store: one writer at a time, also after one was killed."""

import os

import pytest

from pipeline.data.atomic import Busy
from pipeline.data.store.files import LEASE, Store


@pytest.fixture
def store(tmp_path):
    return Store(f"memory://{tmp_path.name}/set")


def test_a_second_writer_is_refused_until_the_first_ends(store):
    with store.hold(), pytest.raises(Busy, match="another command"), store.hold():
        pass
    assert store.list() == {}
    with store.hold():
        pass


@pytest.mark.parametrize(
    ("left", "refused"),
    [("{here} {pid}", True), ("{here} {none}", False), ("elsewhere {none}", True), ("", True)],
)
def test_what_a_killed_writer_left_holds_only_if_it_may_live(store, left, refused):
    # no Linux has a process of the number `none`
    text = left.format(here=os.uname().nodename, pid=os.getpid(), none=2**22 + 1)
    assert store.write_new(LEASE, text.encode())
    if refused:
        with pytest.raises(Busy, match=rf"delete {store.url}/{LEASE}$"), store.hold():
            pass
    else:
        with store.hold():
            assert store.read(LEASE).decode() == f"{os.uname().nodename} {os.getpid()}"

"""Objects on a store: listed, read, written and deleted; a store that refuses or is silent is one
line."""

import threading
import time

import fsspec
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from pipeline.data.store import files
from pipeline.data.store.files import Store, StoreError


@pytest.fixture
def store(tmp_path):
    return Store(f"memory://{tmp_path.name}/set")


def test_what_is_put_is_listed_and_got_by_the_same_name(store, tmp_path):
    assert store.list() == {}
    (tmp_path / "sent").write_bytes(b"four")
    store.put(tmp_path / "sent", "a/b.txt")
    # a neighbour whose name begins alike is none of it
    Store(f"{store.url}-2").write_new("d", b"")
    assert store.list() == {"a/b.txt": 4}
    assert store.get("a/b.txt", tmp_path / "got", 4) and (tmp_path / "got").read_bytes() == b"four"
    assert store.read("none") is None and not store.get("none", tmp_path / "none", 4)
    store.delete(["a/b.txt", "none"])
    assert store.list() == {}


def test_an_object_is_created_once(store):
    assert store.write_new("lease", b"1") and not store.write_new("lease", b"2")
    assert store.read("lease") == b"1"


class Broken(MemoryFileSystem):
    """A store that is silent, or whose library has errors of its own."""

    protocol, ended = "broken", threading.Event()

    def cat_file(self, path, start=None, end=None, **kwargs):
        self.ended.wait(60)
        return b""

    def find(self, path, maxdepth=None, withdirs=False, detail=False, **kwargs):
        raise OSError("Forbidden: b/sets/o\nhas no storage.objects.list access")


def test_a_store_that_refuses_or_is_silent_is_one_line_soon(monkeypatch):
    fsspec.register_implementation("broken", Broken, clobber=True)
    monkeypatch.setattr(files, "ANSWER", 0.2)
    store, began = Store("broken://x/set"), time.monotonic()
    with pytest.raises(
        StoreError, match=r"^cannot list broken://x/set: Forbidden: .*access; check"
    ):
        store.list()
    with pytest.raises(
        StoreError, match=r"^cannot read broken://x/set/a: no answer for 0 s; check"
    ):
        Store("broken://x/set")._do("read", "a", lambda fs, _: fs.cat_file("a"), 0.2)
    assert time.monotonic() - began < 20
    Broken.ended.set()


def test_a_store_without_its_library_is_one_line():
    with pytest.raises(StoreError, match=r"^nosuch://x: Protocol not known: nosuch"):
        Store("nosuch://x").list()


def test_a_bucket_that_is_not_there_is_no_empty_one(monkeypatch, tmp_path):
    class Gone(MemoryFileSystem):
        def find(self, path, maxdepth=None, withdirs=False, detail=False, **kwargs):
            raise FileNotFoundError("the bucket does not exist")

        put_file = find

    fsspec.register_implementation("gone", Gone, clobber=True)
    (tmp_path / "a").touch()
    for use in (Store("gone://x").list, lambda: Store("gone://x").put(tmp_path / "a", "a")):
        with pytest.raises(StoreError, match="the bucket does not exist"):
            use()

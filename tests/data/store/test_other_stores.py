"""Stores without what S3 has: they are read only; other names for what changed, the hub's own
ways."""

import fsspec
import huggingface_hub.constants
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from pipeline.data.reading import read_regular
from pipeline.data.store.files import Store, StoreError
from pipeline.data.store.mirror import open_url
from pipeline.data.store.user_cache import CACHE
from tests.data.hub_files import FileHub
from tests.export.hub import running


class Plain(MemoryFileSystem):
    """A store without ETags and without conditions: what is there is written over, and a file has
    its length and a time."""

    protocol, store, pseudo_dirs = "plain", {}, [""]
    said = ("name", "size", "type", "mtime")

    def pipe_file(self, path, value, mode="overwrite", **options):
        super().pipe_file(path, value)

    def info(self, path, **options):
        return self._less(super().info(path))

    def ls(self, path, detail=True, **options):
        found = [self._less(each) for each in super().ls(path, detail=True)]
        return found if detail else [each["name"] for each in found]

    def _less(self, info):
        return {
            key: value
            for key, value in (info | {"mtime": info.get("created")}).items()
            if key in self.said
        }


@pytest.fixture
def plain(monkeypatch):
    fsspec.register_implementation("plain", Plain, clobber=True)
    monkeypatch.setattr(Plain, "store", {})
    return "plain://sets/a"


@pytest.fixture
def hub(monkeypatch):
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_DISABLE_XET", True)
    monkeypatch.setenv("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    with running(FileHub) as server:
        monkeypatch.setitem(fsspec.config.conf, "hf", {"endpoint": server.address, "token": "hf_0"})
        yield "hf://datasets/me/set/a"


@pytest.mark.parametrize("place", ["plain", "hub"])
def test_a_store_without_conditions_is_read_and_never_written(
    place, request, tmp_path, monkeypatch
):
    url = request.getfixturevalue(place)
    monkeypatch.setenv(CACHE, str(tmp_path))
    for name, data in (("manifest.yaml", b"1"), ("episodes/e.hdf5", b"e" * 3000)):
        Store(url).write(name, data)
    listed = Store(url).list()
    assert list(listed) == ["episodes/e.hdf5", "manifest.yaml"]
    assert {name: Store(url).stat(name) for name in listed} == listed
    with open_url(url, writes=False, made=True) as root:
        assert read_regular(root / "episodes/e.hdf5") == b"e" * 3000
    Store(url).write("manifest.yaml", b"2")
    with open_url(url, writes=False, made=True) as root:
        assert read_regular(root / "manifest.yaml") == b"2"
    with pytest.raises(StoreError, match=f"^{url}: can be read, not written"), open_url(url):
        pass
    assert list(Store(url).list()) == list(listed)


def test_a_store_that_does_not_say_what_changed_is_refused_in_one_line(plain, monkeypatch):
    Store(plain).write("a", b"")
    monkeypatch.setattr(Plain, "said", ("name", "size", "type"))
    with pytest.raises(
        StoreError,
        match=(
            r"^plain://sets/a/a: this store does not say which bytes an object has or when it"
            r" changed"
        ),
    ):
        Store(plain).list()


class Refusing(Plain):
    """A store whose library has errors of its own: for a condition that does not hold, and, as
    gcsfs, for a lack of permission."""

    def pipe_file(self, path, value, mode="overwrite", **options):
        if mode == "create" and self.exists(path):
            error = Exception("At least one of the pre-conditions you specified did not hold., 412")
            error.code = 412
            raise error
        super().pipe_file(path, value)


def test_a_condition_that_does_not_hold_is_no_fault(plain, monkeypatch):
    fsspec.register_implementation("plain", Refusing, clobber=True)
    monkeypatch.setattr("pipeline.data.store.files.CONDITIONAL", ("plain",))
    store = Store(plain, pauses=())
    assert store.create("a", b"1") and not store.create("a", b"2") and store.read("a") == b"1"


def test_a_refusal_in_words_only_is_told_with_its_fix(plain, monkeypatch):
    def refuse(*_, **__):
        raise OSError("Forbidden: b/sets/o\nhas no storage.objects.list access")

    monkeypatch.setattr(Plain, "find", refuse)
    with pytest.raises(
        StoreError,
        match=(
            r"^cannot list plain://sets/a: the credential has no permission: grant it, .* access\)$"
        ),
    ):
        Store(plain).list()

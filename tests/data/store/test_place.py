"""The directory in which a command works on what a store holds; pull and push."""

import os
from pathlib import Path

import pytest

from pipeline.data.atomic import Busy
from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key, SlotKeys
from pipeline.data.process.machine import CACHE
from pipeline.data.reading import read_regular
from pipeline.data.recipe.model import parse_recipe
from pipeline.data.slots.reread import IndexWriter
from pipeline.data.store import place
from pipeline.data.store.files import Store, StoreError, url_of
from pipeline.data.store.place import Place, open_place, place_of, with_urls
from pipeline.run.copy import pull, push
from tests.synthetic import make_episode

KEYS = SlotKeys(Key({"core": "1"}), Key({"renderer": "2"}), Key({"phrases": "3"}))
RECIPE = parse_recipe({"tasks": "click_bell", "levels": [1], "episodes": 2})


@pytest.fixture
def url(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE, str(tmp_path / "cache"))
    return f"memory://{tmp_path.name}/set"


@pytest.fixture
def fetched(monkeypatch):
    names, fetch = [], Place.fetch

    def note(self, path):
        names.append(self.name(path))
        return fetch(self, path)

    monkeypatch.setattr(Place, "fetch", note)
    return names


def write(root, **files):
    for name, data in files.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def test_what_a_command_writes_is_on_the_store_and_nothing_stays_here(url, tmp_path, fetched):
    with open_place(url, writes=True) as root:
        write(root, manifest=b"1", episodes__a=b"a", episodes__b=b"b")
        assert with_urls(f"{root}/x: no") == f"{url}/x: no"
        mine = place_of(root / "x")
        assert mine and mine.root == root and place_of(tmp_path) is None
    assert sorted(Store(url).list()) == ["episodes/a", "episodes/b", "manifest"]
    with open_place(url, writes=True) as root:
        assert fetched == ["manifest"] and not (root / "episodes").exists()
        assert read_regular(root / "episodes/a") == b"a"
        with pytest.raises(FileNotFoundError):
            read_regular(root / "episodes/c")
        write(root, episodes__a=b"new")
        place.delete(root / "episodes/b")
    assert Store(url).read("episodes/a") == b"new"
    assert sorted(Store(url).list()) == ["episodes/a", "manifest"]
    assert not list((tmp_path / "cache/places").iterdir())


def test_a_directory_of_a_process_that_was_killed_is_removed(url, tmp_path):
    left = tmp_path / f"cache/places/s3%3A%2F%2Fx~{os.uname().nodename}.999999999.x"
    left.mkdir(parents=True)
    with open_place(url):
        assert not left.exists()


def test_a_second_writer_is_refused_and_a_reader_is_not(url):
    with open_place(url, writes=True):
        who = rf"another command is writing it \(process {os.getpid()} "
        with pytest.raises(Busy, match=who), open_place(url, writes=True):
            pass
        with open_place(url):
            pass
    with pytest.raises(StoreError, match=r"^hf://datasets/a/b: can only be read"):
        push(Path("/nowhere"), "hf://datasets/a/b")


def test_a_build_resumes_from_an_empty_directory(url, fetched):
    """The index says which episodes are there by their sizes; what it does not know is read."""
    with open_place(url, place.REPORT, writes=True) as root:
        dataset = Dataset(root)
        dataset.create(RECIPE)
        for slot in RECIPE.slots():
            seed, alpha = RECIPE.spec(slot, 0).seed, slot.cell.alpha
            path, index = dataset.episode(slot), slot.index
            meta = KEYS.header()
            make_episode(path, level=1, alpha=alpha, slot=index, seed=seed, frames=3, meta=meta)
        with IndexWriter(dataset, RECIPE) as index:
            index.catch_up()
        (slot, _), (other, _) = dataset.records(RECIPE)
        dataset.index.unlink()
    with open_place(url, place.REPORT, writes=True) as root:
        dataset = Dataset(root)
        with IndexWriter(dataset, RECIPE) as index:
            assert index.catch_up() == set() and len(dataset.rows(RECIPE)) == 2
            assert not dataset.episode(slot).exists()
        assert {name for name in fetched if name.endswith("hdf5")} == {
            f"episodes/{each.path}.hdf5" for each in (slot, other)
        }
    fetched.clear()
    Store(url).delete([f"episodes/{other.path}.hdf5"])
    Store(url).write_new(f"episodes/{other.path}.hdf5", b"other bytes")
    with open_place(url, place.REPORT, writes=True) as root:
        with IndexWriter(Dataset(root), RECIPE) as index:
            assert index.catch_up() == {other}
        assert f"episodes/{slot.path}.hdf5" not in fetched


def test_pull_and_push_move_what_differs(url, tmp_path):
    write(tmp_path / "a", manifest=b"1", episodes__a=b"a", episodes__b=b"b")
    assert push(tmp_path / "a", url) == (3, 3) and push(tmp_path / "a", url) == (3, 1)
    assert pull(url, tmp_path / "b") == (3, 3) and pull(url, tmp_path / "b") == (3, 1)
    write(tmp_path / "b", episodes__a=b"longer")
    (tmp_path / "b/episodes/b").unlink()
    assert pull(url, tmp_path / "b") == (3, 3)
    assert (tmp_path / "b/episodes/a").read_bytes() == b"a"
    with pytest.raises(StoreError, match="there is nothing"):
        pull(f"{url}-2", tmp_path / "c")


def test_names_that_are_no_paths_below_a_directory_are_left_out(url, tmp_path):
    for name in ("../x", "a/../../x", "/x", "ok"):
        MEMORY = Store(url)._at[0]
        MEMORY.store[f"{Store(url)._at[1]}/{name}"] = MEMORY.store.get("x") or _file(MEMORY, url)
    assert list(Store(url).list()) == ["ok"]


def _file(fs, url):
    fs.pipe_file(f"{url}/ok", b"")
    return fs.store[f"{Store(url)._at[1]}/ok"]


@pytest.mark.parametrize("text", ["s3://b/a?", "s3://b/../c", "sftp://host/x", "s3:", "https://a"])
def test_what_is_no_url_of_a_store_is_refused(text):
    with pytest.raises(StoreError, match="is no URL that can be used"):
        url_of(text)


def test_urls_and_paths_are_told_apart():
    assert url_of("s3:/b/c/") == "s3://b/c" == url_of(Path("s3://b/c"))
    assert url_of("/tmp/s3:x") is None and url_of(Path("out")) is None

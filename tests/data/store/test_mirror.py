"""The directory that stands for a dataset on a store: what is fetched and when, what is sent, and
what counts."""

import os
from pathlib import Path

import pytest

from pipeline.data.atomic import write_atomic
from pipeline.data.keys import file_hash
from pipeline.data.reading import read_regular
from pipeline.data.store.files import StoreError
from pipeline.data.store.lock import Busy
from pipeline.data.store.mirror import (
    Mirror,
    delete_uploaded,
    mirror_of,
    open_url,
    replace_directory,
    upload,
)
from pipeline.data.store.mirror_files import is_listed, is_new, state_of
from pipeline.data.store.places import forget
from pipeline.data.store.urls import url_of, with_urls
from pipeline.data.store.user_cache import CACHE


@pytest.fixture
def url(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE, str(tmp_path / "cache"))
    return f"memory://{tmp_path.name}/set"


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Go on on another machine."""

    def move(name):
        monkeypatch.setenv(CACHE, str(tmp_path / name))

    return move


def fill(url):
    with open_url(url) as root:
        for name in (
            "manifest.yaml",
            "index.sqlite",
            "episodes/t/r/L1/clean/episode_0000000.hdf5",
            "exports/x/data",
        ):
            write_atomic(root / name, name.encode())
    return root


def test_what_one_command_writes_the_next_one_reads_elsewhere(url, elsewhere):
    first = fill(url)
    stamps = {path.relative_to(first): state_of(path) for path in first.rglob("*.*")}
    elsewhere("other")
    with open_url(url, writes=False) as root:
        assert root != first
        assert {path.relative_to(root): state_of(path) for path in root.rglob("*.*")} == stamps
        episode = root / "episodes/t/r/L1/clean/episode_0000000.hdf5"
        assert (
            is_listed(episode)
            and not is_listed(root / "manifest.yaml")
            and not is_listed(root / "index.sqlite")
        )
        assert file_hash(episode) == file_hash(first / episode.relative_to(root))
        assert not is_listed(episode) and state_of(episode) == stamps[episode.relative_to(root)]


def test_what_the_store_lacks_does_not_count(url):
    root = fill(url)
    (root / "episodes/t/r/L1/clean/episode_0000001.hdf5").write_bytes(b"its command was killed")
    (root / "manifest.yaml").write_bytes(b"changed by a killed command")
    with open_url(url, writes=False) as again:
        assert again == root
        assert sorted(p.name for p in root.rglob("episode_*")) == ["episode_0000000.hdf5"]
        assert (root / "manifest.yaml").read_bytes() == b"manifest.yaml"


def test_an_object_that_changed_is_fetched_again(url, elsewhere):
    root = fill(url)
    elsewhere("other")
    with open_url(url) as other:
        write_atomic(other / "manifest.yaml", b"MANIFEST.yaml")
    elsewhere("cache")
    with open_url(url, writes=False):
        assert (root / "manifest.yaml").read_bytes() == b"MANIFEST.yaml"


def test_files_are_sent_and_withdrawn_at_once_and_dropped_files_come_back(url):
    with open_url(url) as root:
        path, mirror = root / "episodes" / "e.hdf5", mirror_of(root)
        write_atomic(path, b"bytes")
        assert is_new(path)
        upload(path)
        assert not is_new(path) and list(mirror.store.list()) == [
            ".writing.json",
            "episodes/e.hdf5",
        ]
        stamp = state_of(path)
        mirror.drop(path)
        assert is_listed(path) and state_of(path) == stamp and os.stat(path).st_blocks == 0
        assert read_regular(path) == b"bytes"
        path.unlink()
        # written by a worker on another machine
        assert read_regular(path) == b"bytes"
        path.unlink()
        delete_uploaded(path)
        with pytest.raises(FileNotFoundError):
            read_regular(path)
    assert mirror.store.list() == {}


def test_index_and_manifest_are_sent_after_what_they_name(url, monkeypatch):
    order = []
    monkeypatch.setattr(Mirror, "_push", lambda self, path: order.append(self.name(path)))
    fill(url)
    assert set(order[:2]) == {"episodes/t/r/L1/clean/episode_0000000.hdf5", "exports/x/data"}
    assert set(order[2:]) == {"manifest.yaml", "index.sqlite"}


def test_a_directory_is_replaced_on_the_store_too_unless_that_fails(url):
    root = fill(url)
    with open_url(url):
        with pytest.raises(ZeroDivisionError), replace_directory(root / "exports"):
            (root / "exports/x/data").unlink()
            1 / 0  # noqa: B018
        assert "exports/x/data" in mirror_of(root).store.list()
    with open_url(url), replace_directory(root / "exports"):
        (root / "exports/x/data").unlink()
        write_atomic(root / "exports/x/other", b"")
    assert [name for name in mirror_of(root).store.list() if name.startswith("exports")] == [
        "exports/x/other"
    ]


def test_a_lost_cache_loses_nothing_of_the_store(url):
    root = fill(url)
    with open_url(url):
        for path in sorted(root.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
    assert len(mirror_of(root).store.list()) == 4


def test_commands_at_the_same_time_have_mirrors_of_their_own(url):
    with open_url(url, writes=False) as a, open_url(url, writes=False) as b:
        assert a != b and mirror_of(b).url == mirror_of(a).url == url
        assert with_urls(f"{b}/x: is {a}, {a}") == f"{url}/x: is {url}, {url}"


def test_a_store_error_is_not_followed_by_more_requests(url, monkeypatch):
    monkeypatch.setattr(Mirror, "push_all", lambda self: pytest.fail("it would only fail again"))
    with pytest.raises(StoreError), open_url(url):
        raise StoreError("lost")


def test_names_that_leave_the_mirror_are_no_files(url, tmp_path):
    with open_url(url, writes=False) as root:
        pass
    store = mirror_of(root).store
    fs, at = store._at
    for name in ("../../x", "a/../../y", "/z", "a//b"):
        fs.store[f"{at}/{name}"] = type(fs.open("memory://any", "wb"))(fs, "any", b"")
    with open_url(url, writes=False):
        assert [p for p in root.rglob("*") if p.is_file()] == []
    assert not (tmp_path / "x").exists() and not (tmp_path / "y").exists()


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("s3://bucket/set/", "s3://bucket/set"),
        ("s3:/bucket/set", "s3://bucket/set"),
        ("hf://datasets/me/set", "hf://datasets/me/set"),
        ("out/set", None),
        ("C:/set", None),
    ],
)
def test_urls_are_told_from_paths(text, found):
    assert url_of(text) == found


def test_paths_outside_of_mirrors_are_left_alone(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"bytes")
    upload(path)
    delete_uploaded(path)
    assert mirror_of(path) is None and path.read_bytes() == b"bytes"


def test_a_url_that_is_too_long_is_one_line(url):
    with pytest.raises(StoreError, match="too long"), open_url(url + "/x" * 200):
        pass


@pytest.mark.parametrize(
    "text",
    [
        "s4://b/x",
        "sftp://host/x",
        "S3://b/x",
        "s3://",
        "s3:b/x",
        "file:///x",
        "http:/h/x",
        "s3://b/q?versionId=1",
        "s3://b/../x",
    ],
)
def test_what_looks_like_a_url_and_is_none_is_refused_in_one_line(text):
    for given in (text, Path(text)):
        with pytest.raises(StoreError) as refused:
            url_of(given)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("text", ["out/a", "a:b/c", "./a:b", "/s4:/x", "C:/x", "s3", "out/s3:/x"])
def test_what_does_not_look_like_a_url_is_a_path(text):
    assert url_of(text) is None and url_of(Path(text)) is None


def test_a_command_whose_lease_was_taken_over_writes_no_more(url):
    with (
        pytest.raises(StoreError, match="another command has begun to write it"),
        open_url(url) as root,
    ):
        write_atomic(root / "a", b"a")
        upload(root / "a")
        Mirror(root).store.write(".writing.json", b"{}")
        mirror_of(root).lost.set()
        write_atomic(root / "b", b"b")
        upload(root / "b")
    assert sorted(Mirror(root).store.list()) == [".writing.json", "a"]


def kept(tmp_path):
    return sorted(path.name for path in (tmp_path / "cache" / "mirrors").iterdir())


@pytest.mark.parametrize("writes", [True, False])
def test_a_place_without_a_dataset_leaves_no_mirror(url, tmp_path, writes, monkeypatch):
    fill(url)
    monkeypatch.setattr(Mirror, "pull", lambda self: pytest.fail("nothing is to be fetched"))
    before = kept(tmp_path)
    for wrong in (f"{url}2", url.removesuffix("/set")):
        said = rf"^{wrong} is no dataset: it has no manifest.yaml$"
        with pytest.raises(StoreError, match=said), open_url(wrong, writes, made=True):
            pytest.fail("there is nothing to work on")
    assert kept(tmp_path) == before
    assert (
        mirror_of(Path(tmp_path / "cache/mirrors" / before[0])).store.stat(".writing.json") is None
    )


def test_a_command_that_makes_nothing_leaves_no_mirror(url, tmp_path):
    with open_url(url) as root:
        (root / "episodes").mkdir()
    assert kept(tmp_path) == []
    with pytest.raises(ValueError), open_url(url) as root:
        write_atomic(root / "episodes/e", b"e")
        raise ValueError
    assert kept(tmp_path) == []


def test_a_mirror_that_another_command_uses_stays(url, tmp_path):
    with open_url(url) as a:
        with open_url(url, writes=False):
            pass
        assert kept(tmp_path) == [a.name, f"{a.name}.lock"]
        write_atomic(a / "manifest.yaml", b"")
    assert kept(tmp_path) == [a.name, f"{a.name}.lock"]


def test_the_mirrors_of_a_url_are_listed_and_removed_unless_they_are_used(url, tmp_path):
    root = fill(url)
    with open_url(url, writes=False):
        with open_url(url, writes=False) as second:
            pass
        with pytest.raises(Busy, match=rf"^{url}: another command on this machine is at work"):
            forget(url)
    neighbour = fill(f"{url}2")
    before = kept(tmp_path)
    assert [place.path for place in forget(url, dry_run=True)] == [str(root), str(second)] and kept(
        tmp_path
    ) == before
    one, other = forget(url)
    # of four small files the second mirror has but two, the others are listed only
    assert one.size == 2 * other.size
    assert kept(tmp_path) == [neighbour.name, f"{neighbour.name}.lock"] and forget(url) == []
    with open_url(url, writes=False) as again:
        assert again == root and (root / "manifest.yaml").read_bytes() == b"manifest.yaml"

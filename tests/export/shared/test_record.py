"""export.json names everything that was written and read, and each way in which directory and
dataset can leave it is named."""

import json
import os
from pathlib import Path

import pytest

from pipeline.data.keys import file_hash
from pipeline.data.names import EXPORT_RECORD
from pipeline.export import EXPORTERS, ExportError
from pipeline.export.shared.record import entries, read_record
from tests.export.running import check_export, run
from tests.synthetic import episode_path, make_episode


@pytest.fixture
def dataset(tmp_path) -> Path:
    for slot in range(2):
        make_episode(episode_path(tmp_path, slot=slot), slot=slot, seed=slot, frames=2)
    return tmp_path


def episodes_of(dataset: Path) -> list[Path]:
    return sorted((dataset / "episodes").rglob("*.hdf5"))


@pytest.mark.parametrize("format", list(EXPORTERS))
def test_every_file_that_is_written_or_read_is_recorded_with_its_hash(dataset, format):
    out, episodes = dataset / "exports" / format, episodes_of(dataset)
    assert check_export(dataset, out, episodes) != []
    summary = run(format, dataset, out, episodes)
    record = read_record(out)
    files = {name for name in entries(out) if name != EXPORT_RECORD}
    assert {name: (entry["sha256"], entry["bytes"]) for name, entry in record.contents.items()} == {
        name: (file_hash(out / name), (out / name).stat().st_size) for name in files
    }
    assert record.inputs == {
        path.relative_to(dataset).as_posix(): file_hash(path) for path in episodes
    }
    assert record.summary == json.loads(json.dumps(summary)) and len(record.code["code"]) == 64
    assert check_export(dataset, out, episodes) == []
    # one byte of any file
    for name in sorted(files - {"README.md"}):
        path, before = out / name, (out / name).read_bytes()
        path.unlink()
        assert check_export(dataset, out, episodes) == [f"{path}: is missing"]
        path.write_bytes(before[:-1] + bytes([before[-1] ^ 1]))
        assert check_export(dataset, out, episodes) == [f"{path}: is not what was written"]
        path.write_bytes(before)
    assert check_export(dataset, out, episodes) == []


def test_episodes_that_came_changed_or_went_are_named(dataset):
    out, (first, second) = dataset / "out", episodes_of(dataset)
    run("puma-gt", dataset, out, [first])
    assert check_export(dataset, out, [first, second]) == [f"{out}: does not hold {second}"]
    name = first.relative_to(dataset).as_posix()
    assert (
        check_export(dataset, out, [second])[0]
        == f"{out}: holds {name}, which is not among the episodes"
    )
    first.write_bytes(first.read_bytes() + b"x")
    assert check_export(dataset, out, [first]) == [f"{out}: {first} has changed since"]


def test_a_card_may_be_edited_and_a_link_is_not_what_was_written(dataset, tmp_path):
    out, episodes = dataset / "out", episodes_of(dataset)
    run("puma-gt", dataset, out, episodes)
    (out / "README.md").write_text("mine")
    assert check_export(dataset, out, episodes) == []
    pickled = out / "lerobot-v2.1" / "ep000" / "gt.pkl"
    moved = tmp_path / "elsewhere"
    pickled.rename(moved)
    pickled.symlink_to(moved)
    assert check_export(dataset, out, episodes) == [f"{pickled}: is a link, not what was written"]
    pickled.unlink()
    os.mkfifo(pickled)
    assert check_export(dataset, out, episodes)[0].startswith(f"{pickled}: is no regular file")
    pickled.unlink()
    folder = pickled.parent.rename(tmp_path / "folder")
    moved.rename(folder / "gt.pkl")
    pickled.parent.symlink_to(folder)
    assert check_export(dataset, out, episodes) == [f"{pickled}: is a link, not what was written"]
    assert read_record(out).foreign() == [pickled.parent]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda said: "no json", "has no readable export.json"),
        (
            lambda said: json.dumps({"format": "parquet", "contents": ["a"]}),
            "is of another version",
        ),
        (lambda said: json.dumps(said | {"frames": 9}), "is not what was written"),
        (
            lambda said: json.dumps(said | {"contents": {"../x": {"sha256": "", "bytes": 1}}}),
            "is of another version",
        ),
        (
            lambda said: json.dumps(said | {"inputs": {"annotations/../../x": ""}}),
            "is of another version",
        ),
    ],
    ids=["damaged", "older", "another count", "a file elsewhere", "an input elsewhere"],
)
def test_a_record_that_cannot_be_used_is_one_line_and_keeps_what_is_there(dataset, change, message):
    out, episodes = dataset / "out", episodes_of(dataset)
    run("puma-gt", dataset, out, episodes)
    (out / EXPORT_RECORD).write_text(change(json.loads((out / EXPORT_RECORD).read_text())))
    (problem,) = check_export(dataset, out, episodes)
    assert message in problem and problem.endswith("; remove the directory and export again")
    before = sorted(entries(out))
    with pytest.raises(ExportError, match=message):
        run("puma-gt", dataset, out, episodes)
    assert sorted(entries(out)) == before


def test_a_file_of_somebody_else_in_an_export_is_named_and_kept(dataset, tmp_path):
    out = tmp_path / "parquet"
    run("parquet", dataset, out, episodes_of(dataset))
    assert read_record(out).foreign() == []
    run("parquet", dataset, out, episodes_of(dataset))
    (out / "notes.txt").write_text("mine")
    assert read_record(out).foreign() == [out / "notes.txt"]
    with pytest.raises(ExportError, match=r"notes\.txt: is no part of the export"):
        run("parquet", dataset, out, episodes_of(dataset))
    assert (out / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    "name",
    [
        "meta/stats_gr00t.json",
        "meta/steps_0.pkl",
        "cache.pkl",
        ".cache/huggingface/x.metadata",
        "data/__pycache__/a.txt",
    ],
)
def test_caches_of_consumers_are_dropped_by_the_next_export(dataset, tmp_path, name):
    out, paths = tmp_path / "parquet", episodes_of(dataset)
    run("parquet", dataset, out, episodes_of(dataset))
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    (out / name).parent.mkdir(parents=True, exist_ok=True)
    (out / name).write_text("of an older export")
    assert read_record(out).foreign() == [] and check_export(dataset, out, paths) == []
    run("parquet", dataset, out, episodes_of(dataset))
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before


def test_a_pickle_that_is_ours_is_no_cache(dataset, tmp_path):
    run("puma-gt", dataset, tmp_path / "gt", episodes_of(dataset))
    assert read_record(tmp_path / "gt").unlisted() == [] and any((tmp_path / "gt").rglob("*.pkl"))

"""An export replaces an older one as a whole, and nothing else."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.data.atomic import Busy
from pipeline.data.keys import file_hash, seal
from pipeline.data.names import EXPORT_RECORD
from pipeline.export import ExportError
from pipeline.export.shared.draft import stage_directory
from tests.export.running import run
from tests.synthetic import episode_path, make_episode


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    """A dataset of five short episodes of different lengths."""
    root = tmp_path_factory.mktemp("grows")
    for slot in range(5):
        make_episode(episode_path(root, slot=slot), slot=slot, seed=slot, frames=2 + slot)
    return root


@pytest.mark.parametrize("format", ["lerobot", "parquet", "zarr"])
def test_an_export_that_is_written_again_has_the_bytes_of_an_empty_directory(
    dataset, tmp_path, format
):
    before, after = ([episode_path(dataset, slot=slot) for slot in range(n)] for n in (1, 3))
    run(format, dataset, tmp_path / "out", before)
    run(format, dataset, tmp_path / "out", after)
    run(format, dataset, tmp_path / "empty", after)
    again, fresh = (
        {p.relative_to(tmp_path / name): p.read_bytes() for p in files_of(tmp_path / name)}
        for name in ("out", "empty")
    )
    assert again == fresh
    said = json.loads((tmp_path / "out" / EXPORT_RECORD).read_text())["inputs"]
    place = "episodes/click_bell/aloha-agilex/L1/clean"
    assert said == {
        f"{place}/episode_{i:07d}.hdf5": file_hash(path) for i, path in enumerate(after)
    }


def files_of(root: Path) -> list[Path]:
    return [p for p in root.rglob("*") if p.is_file()]


RECORD, OTHER = (
    seal({"format": "aloha", "code": {}, "inputs": {}, "contents": {}, "x": x}).decode()
    for x in (1, 2)
)


def test_killed_exports_are_swept_away_and_a_half_done_swap_is_completed(dataset):
    out = dataset / "exports" / "x"
    done = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"],
        capture_output=True,
        text=True,
        check=True,
    )
    dead = out.with_name(f".x.{os.uname().nodename}.{done.stdout.strip()}.tmp")
    dead.mkdir(parents=True)
    (dead / "half").write_text("")
    old = out.with_name(".x.old")
    old.mkdir()
    (old / EXPORT_RECORD).write_text(RECORD)
    with stage_directory(out, dataset, "aloha") as folder:
        # the run killed between the two renames had an older export
        assert (out / EXPORT_RECORD).read_text() == RECORD
        (folder / EXPORT_RECORD).write_text(OTHER)
    assert (out / EXPORT_RECORD).read_text() == OTHER
    assert [p.name for p in out.parent.iterdir()] == ["x"]


def test_an_export_is_replaced_by_one_command_at_a_time(dataset):
    out = dataset / "exports" / "x"
    with stage_directory(out, dataset, "aloha") as folder:
        (folder / EXPORT_RECORD).write_text(RECORD)
    with stage_directory(out, dataset, "aloha") as folder:
        with (
            pytest.raises(Busy, match="exports/x: another command is writing it"),
            stage_directory(out, dataset, "aloha"),
        ):
            pass
        (folder / EXPORT_RECORD).write_text(OTHER)
    assert (out / EXPORT_RECORD).read_text() == OTHER
    with stage_directory(out, dataset, "aloha"):
        pass


def test_what_is_no_export_is_not_replaced(dataset):
    out = dataset / "exports" / "mine"
    out.mkdir(parents=True)
    (out / "thesis.txt").write_text("years of work")
    with (
        pytest.raises(ExportError, match="is not an export"),
        stage_directory(out, dataset, "aloha"),
    ):
        pass
    with (
        pytest.raises(ExportError, match="is a file"),
        stage_directory(out / "thesis.txt", dataset, "aloha"),
    ):
        pass
    for above in (dataset, dataset.parent):
        with (
            pytest.raises(ExportError, match="holds the dataset"),
            stage_directory(above, dataset, "aloha"),
        ):
            pass
    assert (out / "thesis.txt").read_text() == "years of work"
    shutil.rmtree(out)
    out.mkdir()
    with stage_directory(out, dataset, "aloha") as folder:  # an empty directory may be
        (folder / EXPORT_RECORD).write_text(RECORD)
    assert (out / EXPORT_RECORD).exists()


def test_an_export_of_another_format_is_not_replaced(dataset):
    out = dataset / "x"
    out.mkdir()
    (out / EXPORT_RECORD).write_text(RECORD)
    with pytest.raises(
        ExportError,
        match=f"^{out}: holds an export in the format aloha: remove it or name another directory$",
    ):
        run("parquet", dataset, out, [episode_path(dataset)])
    assert [path.name for path in out.iterdir()] == [EXPORT_RECORD]


def test_no_export_is_written_among_the_files_of_the_dataset(tmp_path):
    make_episode(episode_path(tmp_path / "data"), frames=2)
    for place in ("episodes", "episodes/click_bell/mine", "ledger", "assets/x"):
        with pytest.raises(ExportError, match="among the dataset's own files"):
            run(
                "parquet",
                tmp_path / "data",
                tmp_path / "data" / place,
                [episode_path(tmp_path / "data")],
            )
    assert [p.name for p in (tmp_path / "data").iterdir()] == ["episodes"]

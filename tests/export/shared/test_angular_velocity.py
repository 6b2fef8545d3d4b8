"""The target's angular velocity: every format with its velocity has it, and none for episodes of
earlier versions."""

from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export import ExportError
from tests.export.running import run
from tests.synthetic import SPIN, episode_path, make_episode

FORMATS = ("aloha", "lerobot", "lerobot-v2.1", "parquet", "robomimic", "robotwin", "xpolicylab")


def exported(format: str, folder: Path, **of_episode: bool) -> np.ndarray | None:
    """Angular velocities (T,3) of the target in an export of one episode, None where it has
    none."""
    path = make_episode(episode_path(folder), frames=4, **of_episode)
    run(format, folder, folder / "out", [path])
    if format in ("lerobot", "lerobot-v2.1", "parquet"):
        table = pq.read_table(
            next(
                p
                for p in (folder / "out").rglob("*.parquet")
                if "data" in str(p.relative_to(folder / "out"))
            )
        )
        column = next(
            (name for name in table.column_names if name.endswith("angular_velocity")), None
        )
        return None if column is None else np.array(table[column].to_pylist())
    with h5py.File(next((folder / "out").rglob("*.hdf5"))) as file:
        if format == "robomimic":
            values = file["data/demo_0/obs/object"][()]
            return values[:, 10:] if values.shape[1] == 13 else None
        return file["target/angular_velocity"][()] if "target/angular_velocity" in file else None


@pytest.mark.parametrize("format", FORMATS)
def test_an_export_has_the_angular_velocity_of_the_episode(format, tmp_path):
    np.testing.assert_allclose(exported(format, tmp_path), [[0, 0, SPIN]] * 4)


@pytest.mark.parametrize("format", FORMATS)
def test_an_episode_of_an_earlier_version_is_exported_without_it(format, tmp_path):
    assert exported(format, tmp_path, spin=False) is None
    with open_episode(episode_path(tmp_path)) as file:
        assert file.read().log.target_angular_velocity is None


def test_one_export_does_not_mix_episodes_with_and_without_it(tmp_path):
    paths = [
        make_episode(episode_path(tmp_path, slot=slot), slot=slot, frames=4, spin=bool(slot))
        for slot in range(2)
    ]
    with pytest.raises(
        ExportError, match=r"angular velocity True differs from False of .*; export them separately"
    ):
        run("lerobot", tmp_path, tmp_path / "out", paths)
    assert not (tmp_path / "out").exists()

"""Labels of all objects in each format that holds them."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export.shared.derived import PLACES
from tests.export.running import run
from tests.synthetic import SPEED, SPIN, episode_path, make_episode

LABELS = ("poses", "twists", "forces")


@pytest.fixture
def episode(tmp_path):
    return make_episode(episode_path(tmp_path), frames=6)


def checked(path, poses, twists, forces):
    """Target first, the objects' own numbers, zeros behind them."""
    with open_episode(path) as e:
        read = e.read()
    log, names = read.log, [read.meta.target, read.meta.manipulated]
    names += sorted(set(read.meta.objects) - set(names))
    names = list(dict.fromkeys(names))
    for i, name in enumerate(names):
        np.testing.assert_allclose(poses[:, i], log.pose(name), atol=1e-6)
    assert not poses[:, len(names) :].any() and not twists[:, len(names) :].any()
    np.testing.assert_allclose(twists[:, 0], [[SPEED, 0, 0, 0, 0, SPIN]] * len(log), atol=1e-6)
    (row,) = log.contacts
    expected = np.zeros((len(log), PLACES))
    expected[row["frame"], 0] = row["impulse"] * read.meta.physics_hz
    np.testing.assert_allclose(forces, expected, rtol=1e-6)


def shaped(columns):
    return [np.stack(c).reshape(6, PLACES, -1).squeeze() for c in columns]


def test_lerobot_and_parquet_hold_labels_of_all_objects(tmp_path, episode):
    run("lerobot", tmp_path, tmp_path / "l", [episode], labels=LABELS)
    (file,) = (tmp_path / "l").glob("data/*/*.parquet")
    table = pq.ParquetFile(file).read()
    checked(episode, *shaped(table[f"objects.{label}"].to_pylist() for label in LABELS))
    info = json.loads((tmp_path / "l/meta/info.json").read_text())["features"]
    assert info["objects.poses"]["names"][:8] == [
        *(f"0_{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")),
        "1_x",
    ]
    run("parquet", tmp_path, tmp_path / "p", [episode], labels=LABELS)
    table = pq.read_table(tmp_path / "p/data-00000.parquet")
    checked(episode, *shaped(table[f"objects_{label}"].to_pylist() for label in LABELS))
    assert table["objects"][0].as_py()[0] == "target"


def test_rlds_steps_hold_them_and_nobody_gets_them_unasked(tmp_path, episode):
    run("rlds", tmp_path, tmp_path / "r", [episode], labels=LABELS)
    run("rlds", tmp_path, tmp_path / "plain", [episode])
    (record,) = (tmp_path / "r").glob("*/*/*.tfrecord-*")
    (plain,) = (tmp_path / "plain").glob("*/*/*.tfrecord-*")
    run("parquet", tmp_path, tmp_path / "p", [episode], labels=("poses",))
    rows = np.stack(pq.read_table(tmp_path / "p/data-00000.parquet")["objects_poses"].to_pylist())
    assert rows.astype(np.float32).tobytes() in record.read_bytes()
    assert b"objects_" not in plain.read_bytes()
    features = json.loads((record.parent / "features.json").read_text())
    step = features["featuresDict"]["features"]["steps"]["sequence"]["feature"]
    shape = step["featuresDict"]["features"]["objects_twists"]["tensor"]["shape"]
    assert shape == {"dimensions": [str(6 * PLACES)]}

"""Depth, segmentation and point clouds: in every format that has a place for them, named where a
format has none."""

import io

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image, ImageColor

from pipeline.data.episode.file import open_episode
from pipeline.export import EXPORTERS, ExportError
from pipeline.run.export import left_out_warning
from tests.export.running import run
from tests.synthetic import episode_path, make_episode

CONFIGURATION = "click_bell/aloha-agilex_L1_clean"


@pytest.fixture
def path(tmp_path):
    """An episode with all three."""
    made = make_episode(episode_path(tmp_path), frames=4, depth=True, segmentation=True)
    with h5py.File(made, "r+") as f:
        f["pointcloud"] = np.random.default_rng(0).random((4, 1024, 6), np.float32)
    return made


def test_robotwin_has_them_as_the_original_writes_them(tmp_path, path):
    out = tmp_path / "out"
    assert "sensors_left_out" not in run("robotwin", tmp_path, out, [path])
    palette = [ImageColor.getrgb(color) for color in sorted(set(ImageColor.colormap.values()))]
    with h5py.File(out / CONFIGURATION / "data/episode0.hdf5") as f, open_episode(path) as e:
        depth, painted = (
            f["observation/left_camera/depth"],
            f["observation/left_camera/actor_segmentation"],
        )
        assert (depth.dtype, painted.dtype, painted.shape) == (
            np.float64,
            np.uint8,
            (4, 240, 320, 3),
        )
        np.testing.assert_array_equal(depth[()], e.array("observation/left_camera/depth"))
        labels = e.array("observation/left_camera/actor_segmentation")
        target = list(f["observation"].attrs["bodies"]).index("target")
        assert (labels == target + 1).any()
        assert {tuple(color) for color in painted[()][labels == target + 1]} == {
            palette[target + 1]
        }
        assert {tuple(color) for color in painted[()][labels == 0]} == {(0, 0, 0)}
        np.testing.assert_array_equal(f["pointcloud"][()], e.array("pointcloud"))


def test_parquet_has_them_without_loss(tmp_path, path):
    plain, out = make_episode(episode_path(tmp_path, slot=1), slot=1, frames=3), tmp_path / "out"
    run("parquet", tmp_path, out, [path, plain])
    rows = pq.read_table(out / "data-00000.parquet").to_pylist()
    with open_episode(path) as e:
        for column, key in (
            ("depth_cam_high", "depth"),
            ("segmentation_cam_high", "actor_segmentation"),
        ):
            images = np.array(
                [np.asarray(Image.open(io.BytesIO(row[column]["bytes"]))) for row in rows[:4]]
            )
            np.testing.assert_array_equal(images, e.array(f"observation/head_camera/{key}"))
        np.testing.assert_array_equal(
            np.array([row["pointcloud"] for row in rows[:4]]).reshape(4, 1024, 6),
            e.array("pointcloud"),
        )
    # an episode without them has nulls
    assert all(
        row[name] is None
        for row in rows[4:]
        for name in ("depth_cam_high", "segmentation_cam_left_wrist", "pointcloud")
    )


def test_lerobot_has_depth_beside_the_features_where_it_is_asked_for(tmp_path, path):
    out = tmp_path / "out"
    assert run("lerobot", tmp_path, out, [path], depth=True)["sensors_left_out"] == [
        "segmentation",
        "pointcloud",
    ]
    # lerobot's policies see every feature of images, whatever its name
    run("lerobot", tmp_path, tmp_path / "plain", [path])
    assert (out / "meta/info.json").read_bytes() == (tmp_path / "plain/meta/info.json").read_bytes()
    rows = pq.read_table(out / "depth/chunk-000/file-000.parquet").to_pylist()
    assert [[row[name] for name in ("index", "episode_index", "frame_index")] for row in rows] == [
        [t, 0, t] for t in range(4)
    ]
    with open_episode(path) as e:
        for name, camera in (
            ("cam_high", "head_camera"),
            ("cam_left_wrist", "left_camera"),
            ("cam_right_wrist", "right_camera"),
        ):
            images = [
                np.asarray(Image.open(io.BytesIO(row[f"depth_{name}"]["bytes"]))) for row in rows
            ]
            np.testing.assert_array_equal(images, e.array(f"observation/{camera}/depth"))
    plain = make_episode(episode_path(tmp_path, slot=1), slot=1, frames=3)
    with pytest.raises(
        ExportError, match="head_camera has no depth images; draw it again with them"
    ):
        run("lerobot", tmp_path, tmp_path / "more", [path, plain], depth=True)


@pytest.mark.parametrize("name", ["lerobot", "lerobot-v2.1", "aloha", "puma-gt"])
def test_a_format_without_a_place_names_what_it_leaves_out(tmp_path, path, name):
    assert run(name, tmp_path, tmp_path / "out", [path])["sensors_left_out"] == [
        "depth",
        "segmentation",
        "pointcloud",
    ]
    plain = make_episode(episode_path(tmp_path, slot=1), frames=3)
    assert "sensors_left_out" not in run(name, tmp_path, tmp_path / "out", [plain])


def test_the_warning_names_the_option_that_writes_a_sensor():
    said = {
        name: left_out_warning(name, ["depth", "segmentation"], EXPORTERS[name].options)
        for name in ("lerobot", "aloha")
    }
    assert said["lerobot"].endswith(
        " has no place for the episodes' segmentation and writes their depth only with --depth"
    )
    assert said["aloha"] == "--format aloha has no place for the episodes' depth, segmentation"

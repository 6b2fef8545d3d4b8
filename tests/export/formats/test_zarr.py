"""Replay buffers, read by the text of zarr's format 2; benchmarks/consumers/readers has zarr and
the policies' own code do it."""

import json

import numpy as np
import pyarrow as pa
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export import ExportError
from tests.export.running import run
from tests.synthetic import episode_path, make_episode


def read(folder) -> np.ndarray:
    """A zarr array: chunks in C order, compressed with zstd, cut to the shape."""
    said = json.loads((folder / ".zarray").read_text())
    assert (said["zarr_format"], said["compressor"]["id"], said["order"], said["filters"]) == (
        2,
        "zstd",
        "C",
        None,
    )
    shape, rows, kind = said["shape"], said["chunks"][0], np.dtype(said["dtype"])
    size = int(np.prod(said["chunks"])) * kind.itemsize
    names = [
        ".".join([str(number), *("0" for _ in shape[1:])]) for number in range(-(-shape[0] // rows))
    ]
    parts = [
        np.frombuffer(pa.decompress((folder / name).read_bytes(), size, "zstd"), kind)
        for name in names
    ]
    return np.concatenate(parts).reshape(-1, *shape[1:])[: shape[0]]


@pytest.fixture
def episodes(tmp_path):
    return [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=3 + i, depth=True)
        for i in range(3)
    ]


def test_rows_are_those_of_the_episodes_one_after_another(episodes, tmp_path):
    out = tmp_path / "out"
    run("zarr", tmp_path, out, episodes, chunk_frames=5, size=(24, 32))
    root = out / "replay_buffer.zarr"
    ends = read(root / "meta/episode_ends")
    assert ends.tolist() == [3, 7, 12] and ends.dtype == np.int64
    assert sorted(p.name for p in (root / "data").iterdir() if p.is_dir()) == sorted(
        [
            "state",
            "action",
            "img",
            "left_camera",
            "right_camera",
            "depth_img",
            "depth_left_camera",
            "depth_right_camera",
        ]
    )
    state, action, depth, images = (
        read(root / "data" / key) for key in ("state", "action", "depth_img", "img")
    )
    for path, start, end in zip(episodes, [0, 3, 7], ends, strict=True):
        with open_episode(path) as e:
            np.testing.assert_array_equal(
                state[start:end], e.array("joint_state/vector").astype(np.float32)
            )
            np.testing.assert_array_equal(
                action[start:end], e.array("joint_action/vector").astype(np.float32)
            )
            np.testing.assert_array_equal(
                depth[start:end], e.array("observation/head_camera/depth")
            )
            want = e.rgb("head_camera", 2).astype(float).reshape(24, 10, 32, 10, 3).mean((1, 3))
            assert np.abs(images[start + 2] - want).max() <= 1


def test_channels_first_and_other_names(episodes, tmp_path):
    out, plain = tmp_path / "first", tmp_path / "last"
    run("zarr", tmp_path, plain, episodes[:1])
    run(
        "zarr",
        tmp_path,
        out,
        episodes[:1],
        channels="first",
        camera_names={"head_camera": "head_camera"},
    )
    first, last = (
        read(out / "replay_buffer.zarr/data/head_camera"),
        read(plain / "replay_buffer.zarr/data/img"),
    )
    np.testing.assert_array_equal(first, last.transpose(0, 3, 1, 2))


def test_episodes_with_other_sensors_are_refused(episodes, tmp_path):
    odd = make_episode(episode_path(tmp_path, slot=5), slot=5, frames=3)
    with pytest.raises(
        ExportError, match=r"depth_img is not as in .*; export them separately with --where"
    ):
        run("zarr", tmp_path, tmp_path / "out", [*episodes, odd])

"""The RoboTwin layout, read as its converters read it, and as readers that want true RGB do."""

import io
import json
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from PIL import Image

from pipeline.data.episode.file import open_episode
from pipeline.export import ExportError, parse_options
from pipeline.export.bridges.robotwin import RobotwinOptions
from pipeline.poses import matrix
from tests.export.running import run
from tests.synthetic import CAMERAS, COLORS, episode_path, make_episode

CONFIGURATION = "click_bell/aloha-agilex_L1_clean"


@pytest.fixture
def episodes(tmp_path):
    """Three episodes of different lengths."""
    return [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=40 + i, frames=4 + i)
        for i in range(3)
    ]


def stock_converter_reads(root: Path, index: int):
    """As the converters of RoboTwin do: all cameras, cv2.imdecode of the bytes as they are, no
    swap; what comes is used as RGB."""
    with h5py.File(root / "data" / f"episode{index}.hdf5") as f:
        names = [
            f"joint_action/{side}_{part}"
            for side in ("left", "right")
            for part in ("arm", "gripper")
        ]
        arms = [f[name][()] for name in names]
        images = {}
        for camera in f["/observation/"]:
            stored = f[f"/observation/{camera}/rgb"][()]
            images[camera] = [
                cv2.imdecode(np.frombuffer(bits, np.uint8), cv2.IMREAD_COLOR) for bits in stored
            ]
    vectors = [np.concatenate((la, [lg], ra, [rg])) for la, lg, ra, rg in zip(*arms, strict=True)]
    said = json.loads((root / "instructions" / f"episode{index}.json").read_text())["seen"]
    return np.array(vectors), images, said


def newer_reader_reads(root: Path, index: int):
    """As readers that expect a standard JPEG do."""
    with h5py.File(root / "data" / f"episode{index}.hdf5") as f:
        return {
            c: [np.asarray(Image.open(io.BytesIO(bits))) for bits in f[f"observation/{c}/rgb"][()]]
            for c in f["observation"]
        }


def error(images, path: Path, camera: str) -> float:
    """Mean squared error of RGB images against the episode's frames."""
    with open_episode(path) as e:
        return float(
            np.mean(
                [
                    (got.astype(float) - want) ** 2
                    for got, want in zip(images, e.frames(camera), strict=True)
                ]
            )
        )


@pytest.mark.parametrize("order", ["rgb", "bgr"])
def test_each_reader_gets_its_colors_in_its_own_order_only(tmp_path, episodes, order):
    out = tmp_path / "out"
    run("robotwin", tmp_path, out, episodes, jpeg_order=order)
    for index, path in enumerate(episodes):
        _, stock, _ = stock_converter_reads(out / CONFIGURATION, index)
        newer = newer_reader_reads(out / CONFIGURATION, index)
        right, wrong = (newer, stock) if order == "rgb" else (stock, newer)
        for camera in CAMERAS:
            assert error(right[camera], path, camera) < 3
            if camera != "left_camera":  # whose square is green: red and blue are the same there
                assert error(wrong[camera], path, camera) > 100
            color = np.abs(right[camera][0].astype(int) - COLORS[camera]).max(-1) < 25
            assert 1200 < color.sum() <= 1700


def test_vectors_instructions_seeds_and_scenes(tmp_path, episodes):
    out = tmp_path / "out"
    summary = run("robotwin", tmp_path, out, episodes)
    assert summary["configurations"] == [CONFIGURATION] and summary["frames"] == 15
    root = out / CONFIGURATION
    for index, path in enumerate(episodes):
        vectors, _, said = stock_converter_reads(root, index)
        with open_episode(path) as e, h5py.File(root / "data" / f"episode{index}.hdf5") as f:
            commanded, measured = e.array("joint_action/vector"), e.array("joint_state/vector")
            # state and action of a frame as ACT's, DP's, pi0's and XPolicyLab's converters take
            # them
            states, actions = vectors[:-1], vectors[1:]
            np.testing.assert_array_equal(actions, commanded[:-1])
            np.testing.assert_array_equal(states[1:], commanded[:-2])
            np.testing.assert_array_equal(states[0], measured[0])
            np.testing.assert_array_equal(f["joint_action/vector"][()], vectors)
            np.testing.assert_array_equal(f["joint_state/vector"][()], measured)
            # else the test could not tell them apart
            assert np.abs(commanded - vectors).max() > 0.01
            for side, last in (("left", 6), ("right", 13)):
                np.testing.assert_array_equal(f[f"endpose/{side}_gripper"][()], vectors[:, last])
            assert said == e.instructions()
            assert "pointcloud" not in f and f.attrs["jpeg_order"] == "rgb" and f.attrs["fps"] == 15
            tcp, hand = (
                matrix(e.array("endpose/left_endpose")),
                matrix(f["endpose/left_endpose"][()]),
            )
            # the original's end effector is 12 cm behind the tool centre point
            np.testing.assert_allclose(
                tcp[:, :3, 3] - hand[:, :3, 3], 0.12 * tcp[:, :3, 0], atol=1e-12
            )
            np.testing.assert_allclose(hand[:, :3, :3], tcp[:, :3, :3], atol=1e-12)
    assert (root / "seed.txt").read_text().split() == ["40", "41", "42"]
    scenes = json.loads((root / "scene_info.json").read_text())
    assert (
        scenes["episode_2"]["info"] == {"{A}": "red bell", "{a}": "left"}
        and scenes["episode_2"]["spec"]["seed"] == 42
    )


def test_cells_have_directories_of_their_own(tmp_path, episodes):
    wide = make_episode(episode_path(tmp_path, "franka-panda"), embodiment="franka-panda", frames=3)
    fast = make_episode(
        tmp_path / "episodes" / "fast.hdf5", level=2, alpha=0.2, domain="randomized", frames=3
    )
    out = tmp_path / "out"
    run("robotwin", tmp_path, out, [*episodes, wide, fast])
    assert sorted(p.name for p in (out / "click_bell").iterdir()) == [
        "aloha-agilex_L1_clean",
        "aloha-agilex_L2@0.2_randomized",
        "franka-panda_L1_clean",
    ]
    assert stock_converter_reads(out / "click_bell/franka-panda_L1_clean", 0)[0].shape == (3, 16)


def test_the_order_has_no_default():
    with pytest.raises(ExportError, match="--format robotwin needs --jpeg-order: bgr for"):
        parse_options("robotwin", RobotwinOptions, {})
    with pytest.raises(ExportError, match="--jpeg-order 'gbr': choose rgb or bgr"):
        parse_options("robotwin", RobotwinOptions, {"jpeg_order": "gbr"})


def test_a_stored_camera_becomes_the_front_camera(tmp_path, monkeypatch):
    monkeypatch.setitem(COLORS, "observer_camera", (200, 180, 20))
    path = make_episode(episode_path(tmp_path), frames=3, cameras=(*CAMERAS[:2], "observer_camera"))
    plain, out = tmp_path / "plain", tmp_path / "out"
    run("robotwin", tmp_path, plain, [path])
    run("robotwin", tmp_path, out, [path], front_camera="observer_camera")
    with (
        h5py.File(plain / CONFIGURATION / "data/episode0.hdf5") as f,
        h5py.File(out / CONFIGURATION / "data/episode0.hdf5") as g,
    ):
        assert sorted(f["observation"]) == ["head_camera", "left_camera", "observer_camera"]
        assert sorted(g["observation"]) == ["front_camera", "head_camera", "left_camera"]
        for key in ("rgb", "cam2world_gl", "intrinsic_cv"):
            np.testing.assert_array_equal(
                g["observation/front_camera"][key][()], f["observation/observer_camera"][key][()]
            )
    with pytest.raises(
        ExportError,
        match=(
            r"--front-camera: .* has no side; its cameras are head_camera, left_camera,"
            r" observer_camera"
        ),
    ):
        run("robotwin", tmp_path, out, [path], front_camera="side")
    assert (
        parse_options(
            "robotwin", RobotwinOptions, {"jpeg_order": "rgb", "front_camera": "observer"}
        ).front_camera
        == "observer_camera"
    )

"""ALOHA HDF5: what ACT and its descendants read, value by value."""

import json

import cv2
import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export import ExportError
from pipeline.export.formats.aloha import joint_velocity
from pipeline.export.shared.episodes import read_facts, reading
from tests.export.running import run
from tests.synthetic import COLORS, episode_path, make_episode

CAMERAS = {
    "cam_high": "head_camera",
    "cam_left_wrist": "left_camera",
    "cam_right_wrist": "right_camera",
}


@pytest.fixture
def episodes(tmp_path):
    """Three episodes of different lengths."""
    return [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=4 + i) for i in range(3)
    ]


def act_reads(path):
    """As ACT's own loader does: keys, raw or compressed pictures with compress_len in the order of
    the names."""
    with h5py.File(path, "r") as f:
        assert f.attrs["sim"]
        names = list(f["observations/images"])
        images = {}
        for number, name in enumerate(names):
            data = f[f"observations/images/{name}"][()]
            if f.attrs["compress"]:
                lengths = f["compress_len"][number]
                data = [
                    cv2.imdecode(row[: int(n)], cv2.IMREAD_COLOR)[..., ::-1]
                    for row, n in zip(data, lengths, strict=True)
                ]
            images[name] = np.stack(list(data))
        return f["observations/qpos"][()], f["observations/qvel"][()], f["action"][()], images


@pytest.mark.parametrize("compress", ["none", "jpeg"])
def test_round_trip(tmp_path, episodes, compress):
    out = tmp_path / "out"
    summary = run("aloha", tmp_path, out, episodes, compress=compress)
    assert summary["episodes"] == 3 and summary["frames"] == 4 + 5 + 6
    assert sorted(p.name for p in out.glob("*.hdf5")) == [f"episode_{i}.hdf5" for i in range(3)]
    for i, path in enumerate(episodes):
        qpos, _, action, images = act_reads(out / f"episode_{i}.hdf5")
        with open_episode(path) as e:
            np.testing.assert_array_equal(qpos, e.array("joint_state/vector").astype(np.float32))
            np.testing.assert_array_equal(action, e.array("joint_action/vector").astype(np.float32))
            for name, camera in CAMERAS.items():
                np.testing.assert_array_equal(images[name], np.stack(list(e.frames(camera))))
        with h5py.File(out / f"episode_{i}.hdf5") as f:
            assert f.attrs["fps"] == 15 and f.attrs["embodiment"] == "aloha-agilex"
            assert list(f.attrs["names"])[:7] == [
                *(f"left_joint{k}" for k in range(1, 7)),
                "left_gripper",
            ]
            assert f["observations/images/cam_high"].chunks[0] == 1
            assert f.attrs["instruction"] in [s.decode() for s in f["instructions/seen"][()]]


def test_a_red_square_is_red(tmp_path, episodes):
    out = tmp_path / "out"
    run("aloha", tmp_path, out, episodes[:1])
    *_, images = act_reads(out / "episode_0.hdf5")
    for name, camera in CAMERAS.items():
        distance = np.abs(images[name][0].astype(int) - COLORS[camera]).max(-1)
        assert 1200 < (distance < 25).sum() <= 1700  # a square of 40 x 40 pixels


def test_velocities_are_the_derivatives_by_name(tmp_path, episodes):
    with reading(episodes[2]) as file:
        facts = read_facts(file, tmp_path)
    got, log = joint_velocity(facts), facts.log
    # the synthetic log moves joint i as 0.5 sin(t + phase_i), so x^2 + v^2 = 1/4
    arms = [i for i, n in enumerate(log.vector_names) if "joint" in n]
    np.testing.assert_allclose(log.state[:, arms] ** 2 + got[:, arms] ** 2, 0.25, atol=1e-12)
    # grippers close linearly from 1 to 0 in 5 / 15 s
    np.testing.assert_allclose(got[:, [6, 13]], -3.0, atol=1e-9)
    log.joints = tuple(n.replace("left_joint1", "left_other") for n in log.joints)
    with pytest.raises(ExportError, match="no joint left_joint1"):
        joint_velocity(facts)


def test_resized_pictures(tmp_path, episodes):
    out = tmp_path / "out"
    for compress in ("none", "jpeg"):
        run("aloha", tmp_path, out, episodes[:1], compress=compress, size=(480, 640))
        *_, images = act_reads(out / "episode_0.hdf5")
        assert images["cam_high"].shape == (4, 480, 640, 3)
        red = (np.abs(images["cam_high"][0].astype(int) - COLORS["head_camera"]).max(-1) < 25).sum()
        assert 4 * 1200 < red < 4 * 1700


def test_embodiments_apart_with_their_own_width(tmp_path, episodes):
    franka = make_episode(
        episode_path(tmp_path, "franka-panda"), embodiment="franka-panda", frames=3
    )
    out = tmp_path / "out"
    run("aloha", tmp_path, out, [*episodes, franka])
    assert act_reads(out / "franka-panda/episode_0.hdf5")[0].shape == (3, 16)
    assert act_reads(out / "aloha-agilex/episode_2.hdf5")[0].shape == (6, 14)
    rows = pq.read_table(out / "aloha-agilex/episodes.parquet").to_pylist()
    assert [r["slot"] for r in rows] == [0, 1, 2] and rows[0]["T_meet"] == pytest.approx(2 / 15)


def test_events_and_spec_travel_along(tmp_path, episodes):
    out = tmp_path / "out"
    run("aloha", tmp_path, out, episodes)
    with h5py.File(out / "episode_1.hdf5") as f:
        assert [name for name, _ in json.loads(f.attrs["events"])] == [
            "meeting",
            "release",
            "success",
        ]
        assert json.loads(f.attrs["spec"])["slot"] == 1


def test_padded_episodes_stack_as_the_loader_of_act_stacks_them(tmp_path, episodes):
    out = tmp_path / "out"
    for compress in ("none", "jpeg"):
        run("aloha", tmp_path, out, episodes, pad_rows=True, compress=compress)
        read = [act_reads(out / f"episode_{i}.hdf5") for i in range(3)]
        assert (
            np.stack([qpos for qpos, *_ in read]).shape
            == np.stack([action for _, _, action, _ in read]).shape
            == (3, 6, 14)
        )
        for i, path in enumerate(episodes):
            length = 4 + i
            with open_episode(path) as e, h5py.File(out / f"episode_{i}.hdf5") as f:
                assert f.attrs["length"] == length and f["is_pad"][()].tolist() == [
                    False
                ] * length + [True] * (6 - length)
                state = e.array("joint_state/vector").astype(np.float32)
                np.testing.assert_array_equal(
                    read[i][0], np.concatenate([state, np.repeat(state[-1:], 6 - length, 0)])
                )
                last = e.rgb("head_camera", length - 1)
            assert all(
                np.array_equal(image, last) for image in read[i][3]["cam_high"][length - 1 :]
            )


def test_the_dimensions_of_the_arms_are_said(tmp_path, episodes):
    franka = make_episode(
        episode_path(tmp_path, "franka-panda"), embodiment="franka-panda", frames=3
    )
    run("aloha", tmp_path, tmp_path / "out", [*episodes, franka])
    for name, joints in (("aloha-agilex/episode_0", 6), ("franka-panda/episode_0", 7)):
        with h5py.File(tmp_path / "out" / f"{name}.hdf5") as f:
            for side in ("left", "right"):
                assert set(f[f"observations/{side}_arm_dim"][()]) == {joints}
            assert f["action"].shape[1] == 2 * joints + 2


def test_compressed_images_are_no_larger_than_the_episodes(tmp_path):
    path = make_episode(episode_path(tmp_path), frames=60)
    run("aloha", tmp_path, tmp_path / "out", [path], compress="jpeg")
    assert (tmp_path / "out/episode_0.hdf5").stat().st_size <= 1.3 * path.stat().st_size


def test_compressed_images_in_the_order_of_readers_that_never_swap(tmp_path, episodes):
    out = tmp_path / "out"
    run("aloha", tmp_path, out, episodes[:1], compress="jpeg", jpeg_order="bgr")
    with h5py.File(out / "episode_0.hdf5") as f, open_episode(episodes[0]) as e:
        row = f["observations/images/cam_high"][0]
        used_as_rgb = cv2.imdecode(row, cv2.IMREAD_COLOR)
        assert (
            f.attrs["jpeg_order"] == "bgr"
            and np.abs(used_as_rgb.astype(int) - e.rgb("head_camera", 0)).mean() < 1
        )
    with pytest.raises(ExportError, match="--jpeg-order bgr needs --compress jpeg"):
        run("aloha", tmp_path, out, episodes[:1], jpeg_order="bgr")

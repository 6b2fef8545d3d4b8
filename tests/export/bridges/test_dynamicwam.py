"""The DynamicWAM files, read under the conditions that its converter sets."""

import cv2
import h5py
import numpy as np
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export import ExportError
from pipeline.poses import matrix
from tests.export.running import run
from tests.synthetic import COLORS, episode_path, make_episode

PLACE = "clean/click_bell/aloha-agilex_L1_clean"
FIELDS = [
    "schema_version",
    "frame_index",
    "sim_step_index",
    "sim_time_seconds",
    "sim_timestep_seconds",
    "motion_start_sim_step_index",
    "motion_start_sim_time_seconds",
    "planned_intercept_sim_time_seconds",
    "planned_intercept_position",
    "target_pose_wxyz",
    "target_contact_poses_wxyz",
    "ee_poses_wxyz",
    "camera_poses_wxyz",
    "gripper_positions",
    "target_gripper_contact_mask",
    "target_gripper_contact_centroids_world",
    "target_gripper_contact_point_counts",
    "first_target_gripper_contact_valid",
    "first_target_gripper_contact_step_index",
    "first_target_gripper_contact_time_seconds",
    "first_target_gripper_contact_centroids_world",
    "first_target_gripper_contact_point_counts",
    "first_target_gripper_contact_ee_poses_wxyz",
    "first_target_gripper_contact_target_poses_wxyz",
    "stable_grasp_succeeded",
]


def converter_reads(path):
    """What the converter demands of a file: 14-wide vectors in range, the 25 fields and no other,
    one clock, decodable images."""
    with h5py.File(path) as f:
        qpos, group = (
            f["joint_action/vector"][()],
            {key: f["interception"][key][()] for key in f["interception"]},
        )
        heads = f["observation/head_camera/rgb"][()]
        for camera in ("head_camera", "left_camera", "right_camera"):
            assert len(f[f"observation/{camera}/rgb"]) == len(qpos)
    grip = [6, 13]
    assert (
        qpos.shape[1] == 14
        and ((qpos[:, grip] >= 0) & (qpos[:, grip] <= 1)).all()
        and (np.abs(qpos) <= 10).all()
    )
    assert set(group) == set(FIELDS) and len(FIELDS) == 25
    assert all(
        value.ndim > 0 and len(value) == len(qpos) and np.isfinite(value).all()
        for value in group.values()
    )
    times, steps, timestep = (
        group[k] for k in ("sim_time_seconds", "sim_step_index", "sim_timestep_seconds")
    )
    assert (group["schema_version"] == 2).all() and np.array_equal(
        group["frame_index"], np.arange(len(qpos))
    )
    np.testing.assert_allclose(np.diff(times), np.diff(steps) * timestep[1:], atol=1e-9)
    return (
        qpos,
        group,
        cv2.cvtColor(
            cv2.imdecode(np.frombuffer(heads[0], np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB
        ),
    )


@pytest.fixture
def episodes(tmp_path):
    return [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=8 + i) for i in range(2)
    ]


def test_the_converter_takes_the_files(tmp_path, episodes):
    out = tmp_path / "out"
    assert run("dynamicwam", tmp_path, out, episodes)["configurations"] == [PLACE]
    for index, path in enumerate(episodes):
        qpos, group, rgb = converter_reads(out / PLACE / "data" / f"episode{index}.hdf5")
        assert (np.abs(rgb.astype(int) - COLORS["head_camera"]).max(-1) < 25).sum() > 1200
        with open_episode(path) as e:
            np.testing.assert_array_equal(group["target_pose_wxyz"], e.array("target/pose"))
            tool, tcp = (
                matrix(group["ee_poses_wxyz"][:, 1]),
                matrix(e.array("endpose/right_endpose")),
            )
            np.testing.assert_allclose(
                tcp[:, :3, 3] - tool[:, :3, 3], 0.12 * tcp[:, :3, 0], atol=1e-12
            )
            # as the original does: the inverse of extrinsic_cv
            extrinsic = e.array("observation/right_camera/extrinsic_cv")
            seen = extrinsic @ matrix(group["camera_poses_wxyz"][:, 2])
            np.testing.assert_allclose(seen, np.broadcast_to(np.eye(4)[:3], seen.shape), atol=1e-6)
            np.testing.assert_array_equal(
                group["gripper_positions"][1:, 0], e.array("joint_action/left_gripper")[:-1]
            )
            # the packer's pairs: the state of frame t is qpos[t], its first action qpos[t + 1]
            np.testing.assert_array_equal(qpos[1:], e.array("joint_action/vector")[:-1])
            contact = int(e.array("state/contacts")["frame"][0])
        # the one contact of the synthetic log is that of the left hand
        assert group["target_gripper_contact_mask"].sum(0).tolist() == [1, 0]
        valid = group["first_target_gripper_contact_valid"]
        assert (
            valid[:, 0].tolist() == [t >= contact for t in range(len(valid))]
            and not valid[:, 1].any()
        )
        assert set(group["first_target_gripper_contact_step_index"][:, 0]) == {-1, 16 * contact}
        assert group["target_contact_poses_wxyz"].shape == (len(valid), 1, 7)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"embodiment": "franka-panda"}, "not 14 wide"),
        ({"cameras": ("head_camera",)}, "has no left_camera"),
    ],
)
def test_what_the_converter_refuses_is_refused_here(tmp_path, how, message):
    path = make_episode(episode_path(tmp_path), frames=4, **how)
    with pytest.raises(ExportError, match=message):
        run("dynamicwam", tmp_path, tmp_path / "out", [path])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("stored", "option"), [("observer_camera", None), ("front_camera", None), ("side", "side")]
)
def test_the_front_camera_that_the_collection_wants(tmp_path, monkeypatch, stored, option):
    monkeypatch.setitem(COLORS, stored, (200, 180, 20))
    path = make_episode(
        episode_path(tmp_path),
        frames=4,
        cameras=("head_camera", "left_camera", "right_camera", stored),
    )
    run("dynamicwam", tmp_path, tmp_path / "out", [path], front_camera=option)
    file = tmp_path / "out" / PLACE / "data" / "episode0.hdf5"
    converter_reads(file)
    with h5py.File(file) as f:
        assert sorted(f["observation"]) == [
            "front_camera",
            "head_camera",
            "left_camera",
            "right_camera",
        ]
        rgb = cv2.imdecode(
            np.frombuffer(f["observation/front_camera/rgb"][0], np.uint8), cv2.IMREAD_COLOR
        )[..., ::-1]
    assert (np.abs(rgb.astype(int) - COLORS[stored]).max(-1) < 25).sum() > 1200

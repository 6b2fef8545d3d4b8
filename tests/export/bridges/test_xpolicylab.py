"""XPolicyLab's v1.0 layout, read as its converters read it; training and evaluation see the same
state."""

import json

import cv2
import h5py
import numpy as np
import pytest

from pipeline.data.episode.file import open_episode
from pipeline.export import ExportError
from tests.export.running import run
from tests.synthetic import COLORS, episode_path, make_episode

PLACE = "DOMINO_L1_clean/click_bell/aloha_agilex"


def packed(file: h5py.File, kind: str) -> np.ndarray:
    """The vector that policies train on: arm, then gripper, left before right."""
    parts = [
        (side, part)
        for side in ("left", "right")
        for part in ("arm_joint_states", "ee_joint_states")
    ]
    return np.concatenate([file[f"{kind}/{side}_{part}"][()] for side, part in parts], axis=1)


@pytest.fixture
def exported(tmp_path, monkeypatch):
    """Two episodes with depth and an observer, and the directory of their export."""
    monkeypatch.setitem(COLORS, "observer_camera", (90, 20, 200))
    cameras = ("head_camera", "left_camera", "observer_camera")
    more = {"cameras": cameras, "depth": True}
    paths = [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=4 + i, **more)
        for i in range(2)
    ]
    run("xpolicylab", tmp_path, tmp_path / "out", paths)
    return paths, tmp_path / "out"


def test_pairs_of_states_give_the_actions_that_are_stored(exported):
    paths, out = exported
    for index, path in enumerate(paths):
        with (
            open_episode(path) as e,
            h5py.File(out / PLACE / "data" / f"episode_{index:07d}.hdf5") as f,
        ):
            state, action, commanded = (
                packed(f, "state"),
                packed(f, "action"),
                e.array("joint_action/vector"),
            )
            np.testing.assert_array_equal(action, commanded.astype(np.float32))
            np.testing.assert_array_equal(state[1:], action[:-1])
            np.testing.assert_array_equal(
                state[0], e.array("joint_state/vector")[0].astype(np.float32)
            )
            tcp = e.array("endpose/left_endpose")
            np.testing.assert_allclose(
                f["action/left_tcp_poses"][()], np.vstack([tcp[1:], tcp[-1:]]), atol=1e-6
            )
            assert np.linalg.norm(f["state/left_ee_poses"][0, :3] - tcp[0, :3]) == pytest.approx(
                0.12, abs=1e-6
            )
            assert (
                f["instruction"].asstr()[()]
                in json.loads(f["instructions"].asstr()[()])
                == e.instructions("seen")
            )
            assert (f["data_format_version"][()], f["additional_info/frequency"][()]) == (
                b"v1.0",
                15,
            )


def test_colors_are_right_for_a_reader_that_never_swaps(exported):
    paths, out = exported
    with open_episode(paths[0]) as e, h5py.File(out / PLACE / "data" / "episode_0000000.hdf5") as f:
        assert sorted(f["vision"]) == ["cam_head", "cam_left_wrist", "cam_third_view"]
        for name, camera in (("cam_head", "head_camera"), ("cam_third_view", "observer_camera")):
            image = cv2.imdecode(
                np.frombuffer(f[f"vision/{name}/colors"][3], np.uint8), cv2.IMREAD_COLOR
            )
            assert np.abs(image.astype(int) - e.rgb(camera, 3)).mean() < 2
            np.testing.assert_array_equal(
                f[f"vision/{name}/depths"][()], e.array(f"observation/{camera}/depth")
            )
        assert f["vision/cam_head/shape"][()].tolist() == [240, 320, 3]


def test_episodes_without_a_camera_of_the_format_are_refused(tmp_path, monkeypatch):
    monkeypatch.setitem(COLORS, "side_camera", (90, 20, 200))
    path = make_episode(episode_path(tmp_path), frames=2, cameras=("side_camera",))
    with pytest.raises(ExportError, match="has none of head_camera"):
        run("xpolicylab", tmp_path, tmp_path / "out", [path])

"""robomimic HDF5, read as its SequenceDataset reads it: through data/demo_i of one file."""

import json
from collections import Counter

import h5py
import numpy as np
import pytest

from pipeline.data.episode.file import open_episode
from tests.export.running import run
from tests.synthetic import episode_path, make_episode


@pytest.fixture
def exported(tmp_path):
    """Three episodes of two levels and the directory of their export."""
    paths = [
        make_episode(
            episode_path(tmp_path, slot=i, level=1 + i % 2),
            slot=i,
            seed=i,
            level=1 + i % 2,
            frames=3 + i,
            depth=True,
        )
        for i in range(3)
    ]
    run("robomimic", tmp_path, tmp_path / "out", paths, size=(24, 32))
    return sorted(paths), tmp_path / "out"


def test_demos_are_the_episodes_and_the_next_observation_is_that_of_the_next_frame(exported):
    paths, out = exported
    with h5py.File(out / "demos.hdf5") as f:
        data = f["data"]
        assert data.attrs["total"] == sum(demo.attrs["num_samples"] for demo in data.values()) == 12
        assert json.loads(data.attrs["env_args"])["env_name"] == "click_bell"
        for index, path in enumerate(paths):
            demo = data[f"demo_{index}"]
            with open_episode(path) as e:
                state, action = e.array("joint_state/vector"), e.array("joint_action/vector")
                last = len(e) - 1
                np.testing.assert_array_equal(demo["actions"][()], action.astype(np.float32))
                np.testing.assert_array_equal(demo["obs/joint_pos"][()], state.astype(np.float32))
                np.testing.assert_array_equal(
                    demo["next_obs/joint_pos"][()],
                    state[[*range(1, last + 1), last]].astype(np.float32),
                )
                images, after = demo["obs/cam_high_image"][()], demo["next_obs/cam_high_image"][()]
                assert images.shape == (last + 1, 24, 32, 3) and images.dtype == np.uint8
                np.testing.assert_array_equal(after, images[[*range(1, last + 1), last]])
                # 10 by 10 pixels are one: means of blocks
                want = e.rgb("head_camera", 1).astype(float).reshape(24, 10, 32, 10, 3).mean((1, 3))
                assert np.abs(images[1] - want).max() <= 1
                assert demo["obs/cam_high_depth"].shape == (last + 1, 24, 32, 1)
                assert set(np.unique(demo["obs/cam_high_depth"])) == {
                    np.float32(0.85),
                    np.float32(0.9),
                }
            np.testing.assert_array_equal(demo["rewards"][()], demo["dones"][()])
            assert demo["dones"][()].tolist() == [0] * last + [1]


def test_masks_name_every_demo_once_by_task_level_and_split(exported):
    _, out = exported
    with h5py.File(out / "demos.hdf5") as f:
        masks = {name: [demo.decode() for demo in names[()]] for name, names in f["mask"].items()}
    assert masks["click_bell"] == ["demo_0", "demo_1", "demo_2"]
    assert Counter(masks["click_bell_L1"] + masks["click_bell_L2"]) == Counter(masks["click_bell"])
    assert Counter(masks.get("train", []) + masks.get("valid", [])) == Counter(masks["click_bell"])

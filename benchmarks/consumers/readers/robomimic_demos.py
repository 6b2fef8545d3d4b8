# /// script
# requires-python = ">=3.12,<3.13"
# dependencies = ["robomimic", "six", "torch", "h5py", "pyarrow", "pillow"]
# ///
"""Reads an export of format robomimic with robomimic's SequenceDataset and compares every step with
the episode files.

domino-data export OUT --format robomimic
uv run --script benchmarks/consumers/readers/robomimic_demos.py OUT

With a checkout of robomimic's main branch on PYTHONPATH its action normalization is tried as well.
"""

import inspect
import sys
from pathlib import Path

import numpy as np
import robomimic.utils.file_utils as file_utils
import robomimic.utils.obs_utils as obs_utils
from robomimic.utils.dataset import SequenceDataset
from stored import episodes

LOW = ["joint_pos", "left_eef_pose", "right_eef_pose", "object"]
RGB = {"cam_high_image": "head_camera", "cam_left_wrist_image": "left_camera"}
NEW = {"action_keys": ["actions"], "action_config": {"actions": {"normalization": "min_max"}}}
"""What SequenceDataset takes since 0.4."""


def main() -> None:
    dataset = Path(sys.argv[1])
    obs_utils.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": LOW, "rgb": list(RGB)}})
    for path in sorted((dataset / "exports" / "robomimic").rglob("demos.hdf5")):
        assert file_utils.get_env_metadata_from_dataset(str(path))["type"] == 2
        files = episodes(dataset, path.parent / "episodes.parquet")
        new = NEW if "action_config" in inspect.signature(SequenceDataset).parameters else {}
        keys = ("actions", "rewards", "dones")
        common = {
            "dataset_keys": keys,
            "seq_length": 4,
            "hdf5_cache_mode": None,
            "hdf5_use_swmr": True,
            "load_next_obs": True,
            **new,
        }
        data = SequenceDataset(hdf5_path=str(path), obs_keys=(*LOW, *RGB), **common)
        assert data.n_demos == len(files) and len(data) == sum(map(len, files))
        row = 0
        for episode in files:
            last = len(episode) - 1
            for t in range(0, len(episode), 7):
                item, after = data[row + t], min(t + 1, last)
                if not new:
                    np.testing.assert_array_equal(
                        item["actions"][0], episode.action[t].astype(np.float32)
                    )
                assert np.abs(item["actions"]).max() <= 1 + 1e-5 or not new
                np.testing.assert_array_equal(
                    item["obs"]["joint_pos"][0], episode.state[t].astype(np.float32)
                )
                np.testing.assert_array_equal(
                    item["next_obs"]["joint_pos"][0], episode.state[after].astype(np.float32)
                )
                for name, camera in RGB.items():
                    for part, frame in (("obs", t), ("next_obs", after)):
                        assert (
                            np.abs(
                                np.asarray(item[part][name][0], float)
                                - episode.image(camera, frame)
                            ).mean()
                            <= 2
                        )
            item = data[row + last]
            assert item["rewards"][0] == item["dones"][0] == 1
            row += len(episode)
        filters = {
            name: len(
                SequenceDataset(
                    hdf5_path=str(path), obs_keys=LOW, filter_by_attribute=name, **common
                )
            )
            for name in ["train"]
        }
        print(
            f"{path.parent.name}: {data.n_demos} demos, {len(data)} samples, masks {filters},"
            f" normalized: {bool(new)}"
        )


if __name__ == "__main__":
    main()

# /// script
# requires-python = ">=3.12,<3.13"
# dependencies = ["numpy", "h5py", "pyarrow", "pillow", "opencv-python-headless", "pyyaml"]
# ///
"""Reads an export of format xpolicylab with XPolicyLab's own loaders and compares state-action
pairs with the episode files.

domino-data export OUT --format xpolicylab
git clone https://github.com/XPolicyLab/XPolicyLab CHECKOUTS/XPolicyLab
PYTHONPATH=CHECKOUTS uv run --script benchmarks/consumers/readers/xpolicylab_pairs.py OUT
"""

import sys
from pathlib import Path

import numpy as np
from stored import close, episodes
from XPolicyLab.utils.data_loader import load
from XPolicyLab.utils.load_file import load_hdf5
from XPolicyLab.utils.process_data import decode_image_bit, pack_robot_state

CAMERAS = {
    "cam_head": "head_camera",
    "cam_left_wrist": "left_camera",
    "cam_right_wrist": "right_camera",
}


def main() -> None:
    dataset = Path(sys.argv[1])
    for folder in sorted(
        path.parent for path in (dataset / "exports" / "xpolicylab").rglob("data")
    ):
        for index, episode in enumerate(episodes(dataset, folder / "episodes.parquet")):
            path = str(folder / "data" / f"episode_{index:07d}.hdf5")
            data, spark = load_hdf5(path), load(path)
            joints = data["state"]["left_arm_joint_states"].shape[1]
            dims = {"arm_dim": [joints] * 2, "ee_dim": [1, 1]}
            state, action = (
                pack_robot_state(data, "joint", dims, "dataset", kind)
                for kind in ("state", "action")
            )
            np.testing.assert_array_equal(action, episode.action.astype(np.float32))
            # readers that make pairs of states alone get the same action with the same image
            np.testing.assert_array_equal(state[1:], action[:-1])
            np.testing.assert_array_equal(state[0], episode.state[0].astype(np.float32))
            for name, camera in CAMERAS.items():
                colors = data["vision"][name]["colors"]
                for t in range(0, len(episode), 5):
                    assert close(decode_image_bit(colors[t]), episode.image(camera, t), 3)
                    assert close(spark["vision"][name]["colors"][t], episode.image(camera, t), 3)
            assert (
                data["instruction"] in episode.sentences
                and set(spark["instructions"]) == episode.sentences
            )
            assert (
                pack_robot_state(
                    data, "ee", {"arm_dim": [7, 7], "ee_dim": [1, 1]}, "dataset", "action"
                ).shape[1]
                == 16
            )
        print(
            f"{folder.parent.parent.name}/{folder.parent.name}/{folder.name}: {index + 1} episodes"
        )


if __name__ == "__main__":
    main()

# /// script
# requires-python = ">=3.12,<3.13"
# dependencies = ["tensorflow", "tensorflow-datasets", "h5py", "pyarrow", "pillow"]
# ///
"""Reads an export of format rlds with tensorflow_datasets and compares every step with the episode
files.

domino-data export OUT --format rlds
uv run --script benchmarks/consumers/readers/rlds.py OUT
"""

import sys
from pathlib import Path

import numpy as np
import tensorflow_datasets as tfds
from stored import StoredEpisode, close

CAMERAS = {
    "cam_high": "head_camera",
    "cam_left_wrist": "left_camera",
    "cam_right_wrist": "right_camera",
}


def main() -> None:
    dataset = Path(sys.argv[1])
    for folder in sorted(
        path.parent for path in (dataset / "exports" / "rlds").rglob("dataset_info.json")
    ):
        builder = tfds.builder_from_directory(str(folder))
        named = tfds.builder(folder.parent.name, data_dir=str(folder.parents[1]))
        assert named.info.splits["train"].num_examples == builder.info.splits["train"].num_examples
        seen = 0
        for example in tfds.as_numpy(builder.as_dataset(split="train")):
            episode = StoredEpisode(dataset, example["episode_metadata"]["file_path"].decode())
            steps = list(example["steps"])
            assert len(steps) == len(episode)
            for t, step in enumerate(steps):
                np.testing.assert_array_equal(step["action"], episode.action[t].astype(np.float32))
                np.testing.assert_array_equal(
                    step["observation"]["state"], episode.state[t].astype(np.float32)
                )
                assert step["language_instruction"].decode() in episode.sentences
                last = t == len(steps) - 1
                assert (step["is_first"], step["is_last"], step["is_terminal"]) == (
                    t == 0,
                    last,
                    last,
                )
                assert step["reward"] == float(last) and step["discount"] == 1
                for name, camera in CAMERAS.items():
                    assert close(step["observation"][name], episode.image(camera, t), 2)
                    if (depth := episode.depth(camera)) is not None:
                        np.testing.assert_array_equal(
                            step["observation"][f"depth_{name}"][..., 0], depth[t]
                        )
            seen += 1
        assert seen == builder.info.splits["train"].num_examples
        print(f"{folder.parent.name}: {seen} episodes, tensorflow_datasets {tfds.__version__}")


if __name__ == "__main__":
    main()

"""Whether the last lerobot that reads v2.1 reads our export: run it in an environment of its own.

    uv venv --python 3.12 V21 && uv pip install --python V21/bin/python lerobot==0.3.3 'av<17'
    domino-data export OUT --format lerobot-v2.1
    V21/bin/python benchmarks/lerobot_v21.py OUT/exports/lerobot-v2.1

Reads every frame of the dataset with its pyav backend, checks clock, task and shapes, and prints
frames a second.
"""

import sys
import time
from pathlib import Path


def main(root: Path) -> None:
    """Read the dataset at `root`; raises AssertionError where a frame is not what it says."""
    import lerobot
    from lerobot.datasets.lerobot_dataset import CODEBASE_VERSION, LeRobotDataset

    assert CODEBASE_VERSION == "v2.1", f"lerobot {lerobot.__version__} reads {CODEBASE_VERSION}"
    dataset = LeRobotDataset("domino/test", root=root, video_backend="pyav")
    start = time.perf_counter()
    expected = [
        (episode, t) for episode, row in dataset.meta.episodes.items() for t in range(row["length"])
    ]
    assert len(expected) == len(dataset) == dataset.meta.total_frames
    for index, (episode, t) in enumerate(expected):
        item = dataset[index]
        assert (int(item["episode_index"]), int(item["frame_index"])) == (episode, t)
        assert abs(float(item["timestamp"]) - t / dataset.fps) < 1e-4
        assert item["task"] == dataset.meta.episodes[episode]["tasks"][0]
        for key in dataset.meta.video_keys:
            assert item[key].shape[0] == 3 and 0.02 < float(item[key].mean()) < 0.98
    rate = len(expected) / (time.perf_counter() - start)
    assert set(dataset.meta.stats) == {
        name for name, feature in dataset.features.items() if feature["dtype"] != "string"
    }
    print(
        f"lerobot {lerobot.__version__} read {dataset.num_episodes} episodes, {len(dataset)}"
        f" frames, {rate:.0f} frames/s"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))

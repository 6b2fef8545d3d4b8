"""Whether a lerobot reads our default export as its users do. Needs lerobot only, so that it runs
in any environment.

    PYTHON benchmarks/consumers/loads.py OUT/exports/lerobot [BACKEND]

Opens the dataset, draws every batch of a plain, shuffled DataLoader with `delta_timestamps`, and
compares state, action and tasks with the Parquet file. BACKEND is the reader of videos, pyav by
default.
"""

import sys
from importlib.metadata import version
from pathlib import Path

import pyarrow.parquet as pq
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset

BATCH, AHEAD = 4, 3


def main(root: Path, backend: str = "pyav") -> None:
    """Read the dataset at `root`; raises AssertionError where a batch is not what the Parquet file
    has."""
    plain = LeRobotDataset("local/plain", root=root, video_backend=backend)
    later = [k / plain.fps for k in range(AHEAD)]
    image = plain.meta.camera_keys[0]
    data = LeRobotDataset(
        "local/plain",
        root=root,
        video_backend=backend,
        delta_timestamps={"action": later, image: [-1 / plain.fps, 0.0]},
    )
    table = pq.read_table(root / "data").to_pydict()
    columns = zip(table["observation.state"], table["action"], table["episode_index"], strict=True)
    rows = dict(zip(table["index"], columns, strict=True))
    batches = torch.utils.data.DataLoader(data, batch_size=BATCH, shuffle=True, num_workers=0)
    seen = []
    for batch in batches:
        assert (
            batch[image].shape[:2] == (len(batch["index"]), 2)
            and 0 < float(batch[image].mean()) < 1
        )
        assert all(
            isinstance(text, str)
            for name in ("task", "subtask", "skill", "stage")
            for text in batch[name]
        )
        for i, index in enumerate(batch["index"].tolist()):
            state, _, episode = rows[index]
            assert torch.equal(batch["observation.state"][i], torch.tensor(state))
            for k in range(AHEAD):
                inside = index + k in rows and rows[index + k][2] == episode
                assert bool(batch["action_is_pad"][i, k]) != inside
                assert not inside or torch.equal(
                    batch["action"][i, k], torch.tensor(rows[index + k][1])
                )
            seen.append(index)
    assert sorted(seen) == list(range(len(plain)))
    print(
        f"lerobot {version('lerobot')}, torch {torch.__version__}, {backend}: {plain.num_episodes}"
        f" episodes, {len(seen)} frames"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])

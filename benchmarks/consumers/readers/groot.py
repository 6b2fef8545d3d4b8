# /// script requires-python = ">=3.12,<3.13" dependencies = ["numpy", "pandas", "pyarrow", "h5py",
# "pillow", "scipy", "tqdm", "av", "opencv-python-headless", "torchvision"] ///
"""Reads an export of format lerobot-v2.1 with the loader of Isaac-GR00T and compares every frame
with the episode files.

domino-data export OUT --format lerobot-v2.1 --embodiment aloha
PYTHONPATH=CHECKOUT uv run --script benchmarks/consumers/readers/groot.py OUT

CHECKOUT is one of Isaac-GR00T (N1.6 or N1.7); only `gr00t/configs`, `gr00t/data` and `gr00t/utils`
are imported.
"""

import json
import sys
from pathlib import Path

import numpy as np
from gr00t.data.dataset.lerobot_episode_loader import LeRobotEpisodeLoader
from gr00t.data.stats import generate_stats
from gr00t.data.types import ModalityConfig
from stored import close, episodes

CAMERAS = {
    "cam_high": "head_camera",
    "cam_left_wrist": "left_camera",
    "cam_right_wrist": "right_camera",
}


def main() -> None:
    dataset = Path(sys.argv[1])
    root = dataset / "exports" / "lerobot-v2.1"
    slices = json.loads((root / "meta" / "modality.json").read_text())
    language = [f"annotation.{name}" for name in slices["annotation"]]
    configs = {
        **{
            kind: ModalityConfig(delta_indices=[0], modality_keys=list(slices[kind]))
            for kind in ("video", "state")
        },
        "action": ModalityConfig(
            delta_indices=list(range(16)), modality_keys=list(slices["action"])
        ),
        "language": ModalityConfig(delta_indices=[0], modality_keys=language),
    }
    statistics = (root / "meta" / "stats.json").read_bytes()
    generate_stats(root)
    assert (root / "meta" / "stats.json").read_bytes() == statistics, (
        "the loader misses statistics and writes its own"
    )
    loader = LeRobotEpisodeLoader(root, configs, video_backend="opencv")
    files = episodes(dataset, root / "meta" / "domino_episodes.parquet")
    assert len(loader) == len(files)
    for number, episode in enumerate(files):
        rows = loader[number]
        assert len(rows) == len(episode)
        for kind, stored in (("state", episode.state[:]), ("action", episode.action[:])):
            for name, part in slices[kind].items():
                wanted = stored[:, part["start"] : part["end"]].astype(np.float32)
                np.testing.assert_array_equal(np.stack(rows[f"{kind}.{name}"]), wanted)
        for name, camera in CAMERAS.items():  # with opencv the loader returns blue first
            images = [image[..., ::-1] for image in rows[f"video.{name}"]]
            assert all(close(image, episode.image(camera, t), 6) for t, image in enumerate(images))
        assert rows[f"language.{language[0]}"].iloc[0] in episode.sentences
    print(f"{len(loader)} episodes, {sum(loader.episode_lengths)} frames")


if __name__ == "__main__":
    main()

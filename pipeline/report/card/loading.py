"""How to load an export: lines that a card shows and a test runs. DIR is the export, ROOT the
dataset.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.html import bullets, code_span

LEROBOT = """
import pandas as pd
from lerobot.datasets import LeRobotDataset

# by default lerobot reads with torchcodec, which needs FFmpeg's libraries (apt install ffmpeg)
episodes = pd.read_parquet("ROOT/meta/domino_episodes.parquet")
train = episodes.loc[episodes["split"] == "train", "episode_index"].tolist()
data = LeRobotDataset("local", root="ROOT", episodes=train, video_backend="pyav")
frame = data[0]  # observation.images.cam_high (3, H, W) in 0..1, observation.state, action, task
"""
DATASETS = """
from datasets import load_dataset

frames = load_dataset("DIR"CONFIG, split="train")
print(frames[0].keys())
"""
EPISODES = """
from pathlib import Path
import pandas as pd

episodes = pd.concat(pd.read_parquet(file) for file in sorted(Path("DIR").rglob("EPISODES")))
train = episodes[episodes["split"] == "train"]  # or "validation", "test"
print(train[["task", "level", "alpha", "length", "physics_id"]])
"""
ALOHA = """
from pathlib import Path
import h5py

with h5py.File(sorted(Path("DIR").rglob("*.hdf5"))[0]) as f:
    actions = f["action"][()]
    print({name: data.shape for name, data in f["observations/images"].items()})
"""
ROBOTWIN = """
import io
from pathlib import Path
import h5py
from PIL import Image

with h5py.File(sorted(Path("DIR").rglob("*.hdf5"))[0]) as f:
    actions = f["joint_action/vector"][()]
    image = Image.open(io.BytesIO(f["observation/head_camera/rgb"][0]))
    print(image.size, f.attrs["jpeg_order"])
"""
PICKLE = """
import pickle
from pathlib import Path

gt = pickle.loads(sorted(Path("DIR").rglob("gt.pkl"))[0].read_bytes())
print(gt["pose7_frame_aligned"].shape)
"""
TRAJECTORY = """
import json
from pathlib import Path
import h5py

with h5py.File(sorted(Path("DIR").rglob("episode_*.hdf5"))[0]) as f:
    print(f["state/left_arm_joint_states"].shape, f["action/left_arm_joint_states"].shape)
    print(list(f["vision"]), json.loads(f["instructions"].asstr()[()]))
"""
DEMOS = """
from pathlib import Path
import h5py

# robomimic: SequenceDataset(hdf5_path=..., obs_keys=["joint_pos", "cam_high_image"], ...)
with h5py.File(sorted(Path("DIR").rglob("demos.hdf5"))[0]) as f:
    demo = f["data/demo_0"]
    print(demo["actions"].shape, {name: values.shape for name, values in demo["obs"].items()})
"""
BUFFER = """
from pathlib import Path
import zarr

buffer = zarr.open(str(sorted(Path("DIR").rglob("replay_buffer.zarr"))[0]), mode="r")
actions, ends = buffer["data/action"][:], buffer["meta/episode_ends"][:]
"""
RLDS = """
from pathlib import Path
import tensorflow_datasets as tfds

folder = sorted(Path("DIR").rglob("dataset_info.json"))[0].parent
for episode in tfds.builder_from_directory(str(folder)).as_dataset(split="SPLIT").take(1):
    print([step["action"].shape for step in episode["steps"]])
"""
BY_FORMAT = {
    "lerobot": {"LeRobot, one split": LEROBOT, "datasets": DATASETS},
    "lerobot-v2.1": {"datasets": DATASETS},
    "parquet": {"datasets": DATASETS},
    "aloha": {"h5py": ALOHA},
    "robotwin": {"h5py": ROBOTWIN},
    "dynamicwam": {"h5py": ROBOTWIN},
    "puma-gt": {"pickle": PICKLE},
    "xpolicylab": {"h5py": TRAJECTORY},
    "robomimic": {"h5py": DEMOS},
    "zarr": {"zarr": BUFFER},
    "rlds": {"tensorflow_datasets": RLDS},
}


def loading(summary: Mapping[str, Any], parts: Sequence[str]) -> dict[str, str]:
    """Tool -> Python code, with DIR still in it. Of several `parts`, which differ in vector
    width, it reads the first.
    """
    name, first = summary["format"], parts[0] if parts else ""
    words = {
        "EPISODES": ("domino_" if name.startswith("lerobot") else "") + "episodes.parquet",
        "SPLIT": "failures" if summary["split"] == "failures" else "train",
        "ROOT": f"DIR/{first}" if first else "DIR",
        "CONFIG": f', "{first.replace("/", "-")}"' if first else "",
    }
    code = {**BY_FORMAT.get(name, {}), "the table of episodes": EPISODES}
    for word, value in words.items():
        code = {tool: text.replace(word, value) for tool, text in code.items()}
    return {tool: text.strip() + "\n" for tool, text in code.items()}


def loading_section(folder: Path, summary: Mapping[str, Any]) -> str:
    infos = (path.relative_to(folder) for path in folder.rglob("meta/info.json"))
    parts = sorted(path.parent.parent.as_posix() for path in infos if len(path.parts) > 2)
    text = "`DIR` is this directory, or on the hub, for `load_dataset`, the repository's name.\n\n"
    if parts:
        held = f"It holds {len(parts)} LeRobot datasets; the code reads the first of them"
        text += f"{held}:\n\n{bullets(map(code_span, parts))}\n"
    return text + "\n".join(
        f"{tool}:\n\n```python\n{code}```\n" for tool, code in loading(summary, parts).items()
    )

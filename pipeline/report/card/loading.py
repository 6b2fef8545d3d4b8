"""How to load an export: a few lines for each tool, as the card shows them and a test runs them.
DIR is the export's directory."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.html import code_span
from pipeline.report.card.markdown import bullets

LEROBOT = """
from lerobot.datasets import LeRobotDataset

# by default lerobot reads with torchcodec, which needs FFmpeg's libraries (apt install ffmpeg)
data = LeRobotDataset("local", root="ROOT", video_backend="pyav")
frame = data[0]  # observation.images.cam_high (3, H, W) in 0..1, observation.state, action, task
"""
LEROBOT_SPLIT = """
import pandas as pd
from lerobot.datasets import LeRobotDataset

episodes = pd.read_parquet("ROOT/meta/domino_episodes.parquet")
train = episodes.loc[episodes["split"] == "train", "episode_index"].tolist()
data = LeRobotDataset("local", root="ROOT", episodes=train, video_backend="pyav")
"""
DATASETS = """
from datasets import load_dataset

frames = load_dataset("DIR"CONFIG, split="train")
print(frames[0].keys())
"""
PANDAS = """
from pathlib import Path
import pandas as pd

frames = pd.concat(pd.read_parquet(file) for file in sorted(Path("ROOT").glob("GLOB")))
print(frames.groupby("episode_index").size())
"""
ARROW = """
import pyarrow.dataset as ds
from glob import glob

frames = ds.dataset(sorted(glob("ROOT/GLOB"))).to_table(columns=["episode_index", "action"])
"""
EPISODES = """
from pathlib import Path
import pandas as pd

episodes = pd.concat(pd.read_parquet(file) for file in sorted(Path("DIR").rglob("EPISODES")))
train = episodes[episodes["split"] == "train"]  # or "validation", "test"
print(train[["task", "level", "alpha", "length", "physics_id"]])
"""
H5 = """
from pathlib import Path
import h5py

with h5py.File(sorted(Path("DIR").rglob("*.hdf5"))[0]) as f:
    f.visit(print)
    actions = f["ACTION"][()]
"""
JPEG = """
import io
from pathlib import Path
import h5py
from PIL import Image

with h5py.File(sorted(Path("DIR").rglob("*.hdf5"))[0]) as f:
    image = Image.open(io.BytesIO(f["observation/head_camera/rgb"][0]))
    print(image.size, f.attrs["jpeg_order"])
"""
H5_ARRAYS = """
from pathlib import Path
import h5py

with h5py.File(sorted(Path("DIR").rglob("*.hdf5"))[0]) as f:
    print({name: data.shape for name, data in f["observations/images"].items()})
"""
PICKLE = """
import pickle
from pathlib import Path

gt = pickle.loads(sorted(Path("DIR").rglob("gt.pkl"))[0].read_bytes())
print(gt["pose7_frame_aligned"].shape)
"""
GLOBS = {
    "lerobot": "data/*/*.parquet",
    "lerobot-v2.1": "data/*/*.parquet",
    "parquet": "data-*.parquet",
}


TRAJECTORY = """
import json
from pathlib import Path
import h5py

with h5py.File(sorted(Path("DIR").rglob("episode_*.hdf5"))[0]) as f:
    print(f["state/left_arm_joint_states"].shape, f["action/left_arm_joint_states"].shape)
    print(list(f["vision"]))
    print(json.loads(f["instructions"].asstr()[()]))
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
    "puma-gt": {"pickle": PICKLE},
    "xpolicylab": {"h5py": TRAJECTORY},
    "robomimic": {"h5py": DEMOS},
    "zarr": {"zarr": BUFFER},
    "rlds": {"tensorflow_datasets": RLDS},
}


def loading(summary: Mapping[str, Any], parts: Sequence[str] = ()) -> dict[str, str]:
    """Tool -> Python code, with DIR still in it, for an export of this summary.

    `parts` are the directories of its LeRobot datasets where there are several (one a robot, or one
    a task): they differ in the width of their vectors, so that the code reads the first one.
    """
    name = summary["format"]
    if name in GLOBS:
        code = {"datasets": DATASETS, "pandas": PANDAS, "pyarrow": ARROW}
        if name == "lerobot":
            code = {"LeRobot": LEROBOT, "LeRobot, one split": LEROBOT_SPLIT} | code
    elif name in BY_FORMAT:
        split = "failures" if summary["split"] == "failures" else "train"
        code = {tool: text.replace("SPLIT", split) for tool, text in BY_FORMAT[name].items()}
    else:
        action = "action" if name == "aloha" else "joint_action/vector"
        code = {
            "h5py": H5.replace("ACTION", action),
            "images": H5_ARRAYS if name == "aloha" else JPEG,
        }
    code["the table of episodes"] = EPISODES.replace(
        "EPISODES", "domino_episodes.parquet" if name.startswith("lerobot") else "episodes.parquet"
    )
    first = parts[0] if parts else ""
    place = {
        "ROOT": f"DIR/{first}" if first else "DIR",
        "CONFIG": f', "{first.replace("/", "-")}"' if first else "",
    }
    place["GLOB"] = GLOBS.get(name, "")
    for word, value in place.items():
        code = {tool: text.replace(word, value) for tool, text in code.items()}
    return {tool: text.strip() + "\n" for tool, text in code.items()}


def loading_section(folder: Path, summary: Mapping[str, Any]) -> str:
    """The section of a card on how to load an export in a directory."""
    roots = (
        path.parent.parent.relative_to(folder).as_posix() for path in folder.rglob("meta/info.json")
    )
    parts = sorted(root for root in roots if root != ".")
    text = (
        "`DIR` is this directory. On the hub, `load_dataset` takes the name of the repository in"
        " its place.\n\n"
    )
    if parts:
        names = bullets(map(code_span, parts))
        text += (
            f"It holds {len(parts)} LeRobot datasets; the code reads the first of"
            f" them:\n\n{names}\n"
        )
    return text + "\n".join(
        f"{tool}:\n\n```python\n{code}```\n" for tool, code in loading(summary, parts).items()
    )

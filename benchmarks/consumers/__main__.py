"""Whether the software that reads our exports takes them, unmodified, and how long it needs.

    domino-data export OUT --format lerobot
    domino-data export OUT --format parquet
    python -m benchmarks.consumers OUT [--steps 20] [--torchcodec] [--environments DIR]

Deletes, splits and merges episodes with lerobot-edit-dataset, reads the results with
LeRobotDataset, draws shuffled batches with a plain DataLoader (`loads.py`), writes an episode for
rerun with lerobot-dataset-viz, trains ACT for a few steps with lerobot-train, and loads both
exports with `datasets.load_dataset(DIR)`. With `--torchcodec` the DataLoader reads with torchcodec,
too, which needs FFmpeg's libraries. With `--environments`, uv makes an environment for each of the
older releases of lerobot in DIR (several GB each) and every one of them draws the same batches;
then the scripts in `readers` that need nothing but packages read the exports rlds, robomimic and
zarr, if they are there. Exit code 1 where one of them fails.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

READ = """
import sys
from lerobot.datasets import LeRobotDataset
for root in sys.argv[1:]:
    data = LeRobotDataset("local/read", root=root, video_backend="pyav")
    first, last = data[0], data[len(data) - 1]
    assert int(last["episode_index"]) == data.num_episodes - 1
    print(data.num_episodes, len(data))
"""
LOADS = Path(__file__).with_name("loads.py")
OLDER = ("0.5.1", "0.4.4")
"""Releases of lerobot that read v3.0, too, the last of their series."""

READERS = {
    "rlds": ("rlds.py",),
    "robomimic": ("robomimic_demos.py",),
    "zarr": ("zarr_buffer.py",),
    "zarr below 3": ("--with", "zarr<3", "--with", "numcodecs<0.16", "zarr_buffer.py"),
}
"""Scripts of readers by the format of the export, with options of `uv run`."""

LOAD = """
import sys
from datasets import load_dataset
for root in sys.argv[1:]:
    print(len(load_dataset(root, split="train")))
"""


@dataclass(frozen=True)
class ReaderOutcome:
    """A command: what it is called, its seconds, its exit code, and the last line it said."""

    name: str
    seconds: float
    code: int
    said: str


def call(name: str, command: list[str], home: Path) -> ReaderOutcome:
    """Run a command without a network, its caches in `home`."""
    offline = {
        "HF_HUB_OFFLINE": "1",
        "HF_HOME": str(home),
        "HF_LEROBOT_HOME": str(home / "lerobot"),
        "WANDB_MODE": "disabled",
    }
    start = time.perf_counter()
    done = subprocess.run(
        command, env=os.environ | offline, capture_output=True, text=True, check=False
    )
    lines = [line for line in (done.stdout + "\n" + done.stderr).splitlines() if line.strip()]
    return ReaderOutcome(
        name, time.perf_counter() - start, done.returncode, lines[-1][:120] if lines else ""
    )


def edit(root: Path, place: Path, home: Path) -> list[ReaderOutcome]:
    """Delete the first episode, split in two, merge the parts, and read all of it."""
    tool = [str(Path(sys.executable).with_name("lerobot-edit-dataset")), "--push_to_hub", "false"]
    source = ["--repo_id", "local/source", "--root", str(root)]
    deleted, split, merged = place / "deleted", place / "split", place / "merged"
    delete = [
        "--new_repo_id",
        "local/deleted",
        "--new_root",
        str(deleted),
        "--operation.type",
        "delete_episodes",
    ]
    parts = [
        "--new_root",
        str(split),
        "--operation.type",
        "split",
        "--operation.splits",
        json.dumps({"train": 0.5, "val": 0.5}),
    ]
    again = [
        "--new_repo_id",
        "local/merged",
        "--new_root",
        str(merged),
        "--operation.type",
        "merge",
    ]
    again += ["--operation.repo_ids", "['local/train', 'local/val']"]
    again += ["--operation.roots", f"['{split / 'train'}', '{split / 'val'}']"]
    return [
        call("edit: delete", [*tool, *source, *delete, "--operation.episode_indices", "[0]"], home),
        call("edit: split", [*tool, *source, *parts], home),
        call("edit: merge", [*tool, *again], home),
        call(
            "read all three",
            [sys.executable, "-c", READ, *map(str, (root, deleted, split / "train", merged))],
            home,
        ),
    ]


def view(root: Path, place: Path, home: Path) -> ReaderOutcome:
    """Write the first episode as a rerun recording with the official viewer."""
    tool = [
        str(Path(sys.executable).with_name("lerobot-dataset-viz")),
        "--repo-id",
        "local/source",
        "--root",
        str(root),
    ]
    return call(
        "lerobot-dataset-viz",
        [*tool, "--episode-index", "0", "--save", "1", "--output-dir", str(place / "rrd")],
        home,
    )


def older(root: Path, environments: Path, home: Path) -> list[ReaderOutcome]:
    """Draw batches with older releases, in environments that uv makes where they are not there
    yet."""
    outcomes = []
    for release in OLDER:
        python = environments / f"lerobot-{release}" / "bin" / "python"
        if not python.exists():
            for command in (
                ["venv", "--python", "3.12", str(python.parents[1])],
                ["pip", "install", "--python", str(python)],
            ):
                subprocess.run(
                    ["uv", *command, *([f"lerobot=={release}"] if command[0] == "pip" else [])],
                    check=True,
                )
        outcomes.append(call(f"DataLoader, {release}", [str(python), str(LOADS), str(root)], home))
    return outcomes


def read(dataset: Path, home: Path) -> list[ReaderOutcome]:
    """Read exports with their consumers' own packages, in environments that uv makes."""
    folder, outcomes = Path(__file__).with_name("readers"), []
    for name, (*options, script) in READERS.items():
        if (dataset / "exports" / name.split()[0]).is_dir():
            command = ["uv", "run", *options, "--script", str(folder / script), str(dataset)]
            outcomes.append(call(f"reader, {name}", command, home))
    return outcomes


def train(root: Path, place: Path, home: Path, steps: int, save: bool = False) -> ReaderOutcome:
    """Train ACT, a small one, from our cameras."""
    command = [
        str(Path(sys.executable).with_name("lerobot-train")),
        "--dataset.repo_id",
        "local/source",
        "--dataset.root",
        str(root),
    ]
    command += [
        "--dataset.video_backend",
        "pyav",
        "--policy.type",
        "act",
        "--policy.device",
        "cpu",
        "--policy.push_to_hub",
        "false",
    ]
    command += ["--policy.chunk_size", "8", "--policy.n_action_steps", "8"]
    command += ["--policy.dim_model", "64", "--policy.dim_feedforward", "64"]
    command += [
        "--policy.n_heads",
        "4",
        "--policy.pretrained_backbone_weights",
        "null",
        "--batch_size",
        "2",
        "--num_workers",
        "0",
    ]
    command += [
        "--steps",
        str(steps),
        "--log_freq",
        "10",
        "--save_checkpoint",
        str(save).lower(),
        "--output_dir",
        str(place / "act"),
    ]
    return call(f"train ACT, {steps} steps", command, home)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument(
        "--torchcodec", action="store_true", help="read videos with torchcodec, too"
    )
    parser.add_argument(
        "--environments", type=Path, help="where environments of older releases are, or are made"
    )
    args = parser.parse_args()
    root, flat = (args.dataset.resolve() / "exports" / name for name in ("lerobot", "parquet"))
    with tempfile.TemporaryDirectory() as folder:
        place, home = Path(folder), Path(folder) / "home"
        outcomes = edit(root, place, home)
        outcomes += [
            call("DataLoader", [sys.executable, str(LOADS), str(root)], home),
            view(root, place, home),
        ]
        if args.torchcodec:
            outcomes.append(
                call(
                    "DataLoader, torchcodec",
                    [sys.executable, str(LOADS), str(root), "torchcodec"],
                    home,
                )
            )
        outcomes += older(root, args.environments.resolve(), home) if args.environments else []
        outcomes.append(train(root, place, home, args.steps))
        outcomes.append(
            call("datasets.load_dataset", [sys.executable, "-c", LOAD, str(root), str(flat)], home)
        )
        outcomes += read(args.dataset.resolve(), home) if args.environments else []
    for o in outcomes:
        print(
            f"{'ok' if o.code == 0 else 'FAIL':5}{o.name:24}{o.seconds:8.1f} s  {o.said}",
            flush=True,
        )
    if any(o.code for o in outcomes):
        sys.exit(1)


if __name__ == "__main__":
    main()

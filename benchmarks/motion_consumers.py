"""Every motion model of the suite `beyond` through what reads a dataset: `python -m
benchmarks.motion_consumers [--level 3] [--out DIR]`.

Builds one episode of a task of the suite `beyond` for each model, verifies it, evaluates the
planned expert in closed loop on a new scene, exports the episode to LeRobot and Parquet, annotates
it, writes its viewer page and reads it as shards of PUMA. Prints one row a model.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import pyarrow.parquet as pq

from benchmarks.hardware import hardware
from pipeline.data.dataset import Dataset
from pipeline.tasks import TASKS
from pipeline.tasks.contract import expand_tasks
from training.puma.config import MixtureSource
from training.puma.corpus.shards import Shards
from training.puma.reading import read_config

CONFIG = "puma-tiny"
ROW = "| {} | {} | {} | {} | {} | {} |"


def command(*words: str | Path) -> None:
    """Run `domino-data` with these arguments; what it prints goes to stderr. Raises
    CalledProcessError."""
    subprocess.run(
        [sys.executable, "-m", "pipeline.cli", *map(str, words), "--quiet"],
        check=True,
        stdout=sys.stderr,
    )


def measure(out: Path, level: int) -> None:
    """Print the table of one dataset with an episode of each of these models."""
    tasks = {TASKS[name].motion: name for name in expand_tasks(["beyond"])}
    data, scores, pages = out / "dataset", out / "evaluation", out / "pages"
    wanted = (
        "--tasks",
        ",".join(tasks.values()),
        "--levels",
        str(level),
        "--episodes",
        "1",
        "--workers",
        "1",
    )
    command("build", *wanted, "--out", data)
    command("verify", data)
    command(
        "evaluate",
        "--policy",
        "replay",
        "--like",
        data,
        "--episodes",
        "1",
        "--workers",
        "1",
        "--out",
        scores,
    )
    command("export", data, "--format", "lerobot")
    command("export", data, "--format", "parquet")
    command(
        "annotate",
        data,
        "--stages",
        "flow,masks",
        "--cameras",
        "head_camera",
        "--mask-source",
        "sim",
    )
    command("view", data, "--out", pages)
    lines = (scores / "episodes.jsonl").read_text().splitlines()
    solved = {row["task"]: row["success"] for row in map(json.loads, lines) if "success" in row}
    files = sorted((Dataset(data).exports("lerobot") / "meta" / "episodes").rglob("*.parquet"))
    frames = sum(
        sum(pq.read_table(file, columns=["length"])["length"].to_pylist()) for file in files
    )
    shards = {
        shard.row.path.parts[0]: shard
        for shard in Shards(MixtureSource(dataset=data), read_config(CONFIG))
    }
    shown = {
        name
        for name in tasks.values()
        for page in pages.rglob("*.js")
        if name in page.read_text("utf-8")
    }
    print(f"level {level}, {frames} LeRobot frames; {hardware()}\n")
    print(ROW.format("model", "task", "evaluated", "frames in shards", "flow and boxes", "viewer"))
    print("|---" * 6 + "|")
    for model, name in sorted(tasks.items()):
        shard = shards[name]
        found = shard.annotations
        annotated = len(found["flow"]["rgb"]) == len(found["masks"]["box"]) == len(shard.time)
        marks = (
            "solved" if solved[name] else "failed",
            len(shard.time),
            "yes" if annotated else "no",
        )
        print(ROW.format(f"`{model}`", f"`{name}`", *marks, "yes" if name in shown else "no"))


def main() -> None:
    """Measure in a temporary directory, or in the one that is given."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--level", type=int, choices=(1, 2, 3), default=3)
    parser.add_argument("--out", type=Path, help="keep what is made here; a rerun resumes")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        measure(args.out or Path(scratch), args.level)


if __name__ == "__main__":
    main()

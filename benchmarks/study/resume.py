"""The same numbers serially and on two workers, both killed with SIGKILL half-way and gone on
with."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

Row = dict[str, Any]
COMMAND = (sys.executable, "-c", "from pipeline.cli import main; main()", "evaluate")


def compare(where: Path, episodes: int, policy: str = "random", task: str = "click_bell") -> str:
    """Evaluate twice below WHERE, a new directory, on the same admitted scenes, and return the
    result as a sentence.

    Raises RuntimeError if the two differ, or if a run could not be killed in time.
    """
    wanted = (
        "--policy",
        policy,
        "--tasks",
        task,
        "--levels",
        "1",
        "--episodes",
        str(episodes),
        "--quiet",
    )
    serial, parallel = where / "serial", where / "parallel"
    shared = ("--manifests", str(serial / "manifests"))
    found: dict[Path, tuple[int, dict[str, Row]]] = {}
    for out, how in (
        (serial, ("--executor", "inline")),
        (parallel, ("--executor", "ray", "--workers", "2", *shared)),
    ):
        command = (*COMMAND, *wanted, *how, "--out", str(out))
        finished = _run_and_kill(command, out / "episodes.jsonl", episodes * 2 // 5)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        found[out] = (finished, _rows(out))
    (a, one), (b, other) = found[serial], found[parallel]
    if one != other or len(one) != episodes:
        different = [key for key in one.keys() | other.keys() if one.get(key) != other.get(key)]
        raise RuntimeError(f"{len(different)} of {len(one)} episodes differ: {different[:1]}")
    solved = sum(row["success"] for row in one.values())
    return (
        f"{episodes} episodes of {policy} on {task}: killed after {a} (one process) and {b} (two"
        f" Ray workers), gone on with, all {len(one)} rows the same in every number but wall time;"
        f" {solved} solved."
    )


def _run_and_kill(command: tuple[str, ...], rows: Path, enough: int) -> int:
    """Start the command, kill its session when so many rows are there; the whole rows that it
    left."""
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)
    while not rows.exists() or rows.read_bytes().count(b"\n") < enough:
        if process.poll() is not None:
            raise RuntimeError(
                f"the evaluation ended with {process.returncode} before it could be killed"
            )
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return rows.read_bytes().count(b"\n")


def _rows(out: Path) -> dict[str, Row]:
    """Rows by key, without wall times."""
    rows = [json.loads(line) for line in (out / "episodes.jsonl").read_text().splitlines()]
    return {row["key"]: {k: v for k, v in row.items() if k != "seconds_spent"} for row in rows}

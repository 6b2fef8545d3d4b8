"""Yield of the static dry runs on fresh layouts: `python -m benchmarks.dry_runs --tasks grab_roller
--robots all --layouts 20`.

Every run lays out the scene of one seed at level 0 and runs the task's expert there
(`stages.dry_run`); no target moves. Prints per cent accepted, tasks down, robots across, the means
with Wilson's 95 % intervals, and the failures by stage, reason and detail.
"""

import argparse
import re
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.hardware import hardware
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.scoring.statistics import wilson
from pipeline.stages.dry_run import dry_run
from pipeline.stages.failure import Failure
from pipeline.stages.scene import build_scene
from pipeline.tasks.contract import expand_tasks
from pipeline.world.robots import MODELS, get_embodiment


@dataclass(frozen=True)
class TimedRun:
    """One dry run: empty `failure` when accepted, else stage, reason and detail; seconds of
    processor time."""

    spec: EpisodeSpec
    failure: str
    seconds: float


def one(spec: EpisodeSpec, rules: Rules) -> TimedRun:
    """Lay out the scene of a spec and run the expert in it."""
    began, failure = time.process_time(), ""
    try:
        dry_run(build_scene(spec, rules), Recipe().fps)
    except Failure as found:
        failure = str(found)
    return TimedRun(spec, failure, time.process_time() - began)


def run(specs: Sequence[EpisodeSpec], rules: Rules, workers: int) -> list[TimedRun]:
    """All specs in fresh processes; a bar shows how far and how well it goes."""
    runs = list[TimedRun]()
    with (
        ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool,
        tqdm(total=len(specs), unit="run") as bar,
    ):
        for r in pool.map(partial(one, rules=rules), specs, chunksize=1):
            runs.append(r)
            bar.update()
            bar.set_postfix_str(f"{np.mean([not x.failure for x in runs]):.0%} accepted")
    return runs


def rates(runs: Sequence[TimedRun], robots: Sequence[str]) -> str:
    """Markdown: tasks down, robots across, per cent of dry runs accepted; below it means with
    intervals and the lowest pairs."""
    tasks = sorted({r.spec.task for r in runs})
    rows = [" | ".join(["| task", *robots, "s per run |"]), "|---|" + "---:|" * (len(robots) + 1)]
    for task in tasks:
        of_task = [r for r in runs if r.spec.task == task]
        cells = [_per_cent([r for r in of_task if r.spec.embodiment == robot]) for robot in robots]
        rows.append(
            " | ".join([f"| {task}", *cells, f"{np.mean([r.seconds for r in of_task]):.1f} |"])
        )
    of_robots = [[r for r in runs if r.spec.embodiment == robot] for robot in robots]
    rows.append(
        " | ".join(
            [
                "| **mean**",
                *(f"**{_per_cent(group)}**" for group in of_robots),
                f"{_mean_seconds(runs)} |",
            ]
        )
    )
    rows.append(" | ".join(["| 95 % interval", *(_interval(group) for group in of_robots), " |"]))
    return "\n".join(rows)


def _per_cent(runs: Sequence[TimedRun]) -> str:
    return f"{100 * np.mean([not r.failure for r in runs]):.0f}"


def _mean_seconds(runs: Sequence[TimedRun]) -> str:
    return f"{np.mean([r.seconds for r in runs]):.1f}"


def _interval(runs: Sequence[TimedRun]) -> str:
    low, high = wilson(sum(not r.failure for r in runs), len(runs))
    return f"{100 * low:.1f}-{100 * high:.1f}"


def failures(runs: Sequence[TimedRun]) -> str:
    """Markdown: why dry runs failed, per task and robot, with the seeds; numbers in the details are
    left out of the grouping."""
    seeds: dict[tuple[str, str, str], list[int]] = {}
    for r in runs:
        if r.failure:
            key = (r.spec.task, r.spec.embodiment, re.sub(r"-?\d+\.\d+", "x", r.failure))
            seeds.setdefault(key, []).append(r.spec.seed)
    rows = ["| task | robot | failure | runs | seeds |", "|---|---|---|---:|---|"]
    for (task, robot, failure), which in sorted(seeds.items()):
        rows.append(
            f"| {task} | {robot} | {failure} | {len(which)} | {' '.join(map(str, which))} |"
        )
    return "\n".join(rows)


def lowest(runs: Sequence[TimedRun], count: int = 5) -> str:
    """One line: the pairs of task and robot with the fewest accepted dry runs."""
    bad, total = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for r in runs:
        pair = (r.spec.task, r.spec.embodiment)
        total[pair] += 1
        bad[pair] += bool(r.failure)
    pairs = sorted(total, key=lambda pair: (-bad[pair] / total[pair], pair))[:count]
    shares = (
        f"{task} on {robot} {100 * (1 - bad[task, robot] / total[task, robot]):.0f} %"
        for task, robot in pairs
    )
    return "Lowest pairs: " + ", ".join(shares)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", default="all", help="names, separated by commas")
    parser.add_argument("--robots", default="all", help="names, separated by commas")
    parser.add_argument("--layouts", type=int, default=20, help="layouts for each task and robot")
    parser.add_argument(
        "--layout",
        default="ours",
        choices=("ours", "original"),
        help="where the robots' bases stand",
    )
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, help="also write the tables here")
    args = parser.parse_args()
    tasks = expand_tasks(args.tasks.split(","))
    robots = (
        list(MODELS)
        if args.robots == "all"
        else [get_embodiment(r).name for r in args.robots.split(",")]
    )
    specs = [
        EpisodeSpec(task, robot, 0, 0.0, "clean", 0, seed)
        for task in tasks
        for robot in robots
        for seed in range(args.first_seed, args.first_seed + args.layouts)
    ]
    runs = run(specs, Rules(layout=args.layout), args.workers)
    what = (
        f"{len(runs)} static dry runs, {args.layouts} layouts a pair, seeds from {args.first_seed},"
        f" layout {args.layout}"
    )
    head = f"{what}, {_mean_seconds(runs)} s of processor time each."
    text = "\n\n".join([head, hardware(), rates(runs, robots), lowest(runs), failures(runs)])
    print(text)
    if args.out:
        args.out.write_text(text + "\n")


if __name__ == "__main__":
    main()

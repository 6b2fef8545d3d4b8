"""Attempt success of tasks x robots x levels, physics only: `python -m benchmarks.success --robots all --levels 1 --seeds 5`.

Prints one row per task and robot and a mean per robot; `--out FILE.md` also writes the table with the reasons of failure. `--alpha`
takes a list and then prints yield and speeds per alpha.
"""

import argparse
import itertools
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.hardware import hardware
from pipeline.manifest import Recipe
from pipeline.spec import EpisodeSpec
from pipeline.stages.failure import Failure
from pipeline.stages.slot import Phases, attempt
from pipeline.tasks import TASKS
from pipeline.world.robots import EMBODIMENTS, get_embodiment

ORIGINAL_STATIC = {"aloha-agilex": 78.2, "arx-x5": 77.9, "franka-panda": 69.0, "piper": 27.0, "ur5-wsg": 61.3}
"""Mean static expert success of the original over its 35 tasks, per cent (RoboTwin 2.0 documentation)."""


@dataclass(frozen=True)
class Try:
    """Outcome of one attempt: empty reason when accepted; seconds of CPU; speeds of the target in m/s."""

    spec: EpisodeSpec
    reason: str
    seconds: float
    average: float = 0.0
    fastest: float = 0.0


def one(spec: EpisodeSpec) -> Try:
    """Run the three stages for one spec."""
    phases = Phases()
    try:
        rollout = attempt(spec, Recipe(), phases)
    except Failure as failure:
        return Try(spec, f"{failure.stage}: {failure.reason}", sum(phases.seconds.values()))
    return Try(spec, "", sum(phases.seconds.values()), rollout.motion.average_speed(), rollout.motion.maximum_speed())


def run(specs: Sequence[EpisodeSpec], workers: int) -> list[Try]:
    """All specs, over processes when asked for more than one worker."""
    if workers == 1:
        return [one(spec) for spec in specs]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return list(pool.map(one, specs, chunksize=1))


def table(tries: Sequence[Try], robots: Sequence[str]) -> str:
    """Markdown: tasks down, robots across, per cent of attempts accepted; means; reasons of failure."""
    by: dict[tuple[str, str], list[Try]] = defaultdict(list)
    for t in tries:
        by[t.spec.task, t.spec.embodiment].append(t)
    tasks = sorted({t.spec.task for t in tries})
    rate = {key: 100 * float(np.mean([not t.reason for t in group])) for key, group in by.items()}
    rows = ["| task | " + " | ".join(robots) + " |", "|---|" + "---:|" * len(robots)]
    rows += [f"| {task} | " + " | ".join(f"{rate[task, robot]:.0f}" for robot in robots) + " |" for task in tasks]
    means = [np.mean([rate[task, robot] for task in tasks]) for robot in robots]
    rows.append("| **mean** | " + " | ".join(f"**{m:.0f}**" for m in means) + " |")
    rows.append("| original, static, its 35 tasks | " + " | ".join(f"{ORIGINAL_STATIC[r]:.0f}" for r in robots) + " |")
    reasons = Counter((t.spec.embodiment, t.spec.task, t.reason) for t in tries if t.reason)
    if reasons:
        rows += ["", "| robot | task | reason | attempts |", "|---|---|---|---:|"]
        rows += [f"| {robot} | {task} | {reason} | {n} |" for (robot, task, reason), n in sorted(reasons.items())]
    return "\n".join(rows)


def alphas(tries: Sequence[Try]) -> str:
    """Markdown: yield and target speeds per alpha."""
    rows = ["| alpha m/s | accepted % | average speed | fastest |", "|---:|---:|---:|---:|"]
    for alpha in sorted({t.spec.alpha for t in tries}):
        group = [t for t in tries if t.spec.alpha == alpha]
        good = [t for t in group if not t.reason]
        speeds = (np.mean([t.average for t in good]), max(t.fastest for t in good)) if good else (0.0, 0.0)
        rows.append(f"| {alpha:g} | {100 * len(good) / len(group):.0f} | {speeds[0]:.3f} | {speeds[1]:.3f} |")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", default="all")
    parser.add_argument("--robots", default="aloha")
    parser.add_argument("--levels", default="1")
    parser.add_argument("--alpha", default="0.1")
    parser.add_argument("--seeds", type=int, default=5, help="attempts per task, robot, level and alpha")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    tasks = sorted(TASKS) if args.tasks == "all" else args.tasks.split(",")
    robots = list(EMBODIMENTS) if args.robots == "all" else [get_embodiment(r).name for r in args.robots.split(",")]
    levels, speeds = [int(x) for x in args.levels.split(",")], [float(x) for x in args.alpha.split(",")]
    specs = [
        EpisodeSpec(task, robot, level, alpha, "clean", 0, seed)
        for task, robot, level, alpha, seed in itertools.product(tasks, robots, levels, speeds, range(args.seeds))
    ]
    tries = run(specs, args.workers)
    accepted = [t for t in tries if not t.reason]
    spent = sum(t.seconds for t in tries) / max(1, len(accepted))
    what = f"{len(tries)} attempts, levels {args.levels}, alpha {args.alpha}"
    head = f"{what}, {spent:.2f} s of physics and planning per accepted episode."
    text = "\n\n".join([head, hardware(), table(tries, robots), *([alphas(tries)] if len(speeds) > 1 else [])])
    print(text)
    if args.out:
        args.out.write_text(text + "\n")


if __name__ == "__main__":
    main()

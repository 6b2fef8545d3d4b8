"""PUMA against itself without history and without auxiliary prediction: several seeds, two tasks,
levels 1 and 3.

    domino-data build --manifest manifests/puma-study.yaml --out DATA
    domino-data annotate DATA --stages flow
    domino-data annotate DATA --stages masks --mask-source sim
    domino-data export DATA --format parquet
    python -m benchmarks.puma_study run --data DATA --out OUT [--seeds 1,2,3] [--configs ...] [--steps 2000] [--episodes 20]
    python -m benchmarks.puma_study page --out OUT

`run` trains and evaluates one configuration after the other, all of a seed before the next seed,
and goes on where it was stopped. All are evaluated on the same admitted scenes. Runs of several
processes can share OUT, each with its own seeds or configurations. `page` writes table and plot
into docs/measurements/training.md.
"""  # noqa: E501

import argparse
import json
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.hardware import hardware
from benchmarks.study.page import inserted
from benchmarks.study.rows import Rate
from pipeline.data.atomic import write_atomic
from pipeline.evaluate.scoring.statistics import bootstrap
from pipeline.evaluate.scoring.summary import scene_of
from pipeline.run.evaluation import evaluation_version
from training.puma.loop.runs import LOG
from training.puma.reading import read_config
from training.puma.train import train

CONFIGS = ("puma-tiny", "puma-tiny-no-history", "puma-tiny-no-auxiliary")
TASKS, LEVELS = ("adjust_bottle", "click_bell"), (1, 3)
DOCS = Path(__file__).parents[1] / "docs"
BEGIN, END = "<!-- puma study: begin -->", "<!-- puma study: end -->"


def run(
    data: Path, out: Path, configs: Sequence[str], seeds: Sequence[int], steps: int, episodes: int
) -> None:
    """Train and evaluate what is missing."""
    for seed in seeds:
        for name in configs:
            folder = out / name / f"seed-{seed}"
            settings = {
                "data.sources": json.dumps([{"dataset": str(data)}]),
                "data.cache": str(out / "cache"),
                "train.seed": str(seed),
                "train.steps": str(steps),
                "train.save_every": str(steps),
            }
            config = read_config(name, [f"{key}={value}" for key, value in settings.items()])
            policy = train(config, folder / "run", quiet=True).checkpoint / "policy.py"
            print(f"{name}, seed {seed}: trained; {hardware()}", flush=True)
            evaluate(policy, folder, out / "manifests", episodes)
            print(f"{name}, seed {seed}: evaluated; {hardware()}", flush=True)


def evaluate(policy: Path, folder: Path, manifests: Path, episodes: int) -> None:
    """Evaluate a policy at every task and level, in place of this process; `folder`/made.json names
    the code and the machine."""
    command = [
        sys.executable,
        "-m",
        "pipeline.cli",
        "evaluate",
        "--policy",
        str(policy),
        "--cameras",
        "head_camera",
    ]
    command += [
        "--tasks",
        ",".join(TASKS),
        "--levels",
        ",".join(map(str, LEVELS)),
        "--episodes",
        str(episodes),
    ]
    command += [
        "--executor",
        "inline",
        "--manifests",
        str(manifests),
        "--out",
        str(folder / "evaluation"),
        "--quiet",
        "--json",
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    write_atomic(
        folder / "made.json",
        json.dumps({"code": evaluation_version()[:12], "hardware": hardware()}).encode(),
    )


@dataclass(frozen=True)
class Run:
    """A finished run: its configuration and seed, rows of the evaluation, rows of the training log
    that were validated."""

    config: str
    seed: int
    episodes: list[dict[str, Any]]
    validated: list[dict[str, Any]]
    made: dict[str, str]


def read_runs(out: Path) -> list[Run]:
    """The runs of OUT that were evaluated, by configuration and seed. Raises FileNotFoundError
    where there is none."""
    runs = []
    for name in CONFIGS:
        for folder in sorted((out / name).glob("seed-*")):
            if (folder / "made.json").exists():
                rows, log = (
                    lines(path)
                    for path in (folder / "evaluation" / "episodes.jsonl", folder / "run" / LOG)
                )
                validated = [row for row in log if "validation_error" in row]
                made = json.loads((folder / "made.json").read_text())
                runs.append(
                    Run(name, int(folder.name.removeprefix("seed-")), rows, validated, made)
                )
    if not runs:
        raise FileNotFoundError(f"{out}: has no finished run")
    return runs


def lines(path: Path) -> list[dict[str, Any]]:
    """The rows of a file of JSON lines."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def scores(runs: Sequence[Run], config: str, task: str, level: int) -> tuple[Rate, list[float]]:
    """Success rate of a configuration at a task and level, all seeds together, and the manipulation
    score of each scene."""
    rows = [
        r
        for run in runs
        if run.config == config
        for r in run.episodes
        if (r["task"], r["level"]) == (task, level)
    ]
    by_scene = defaultdict[Any, list[float]](list)
    for row in rows:
        by_scene[scene_of(row)].append(row["manipulation_score"])
    return Rate.of(rows), [float(np.mean(values)) for values in by_scene.values()]


def table(runs: Sequence[Run]) -> str:
    """A Markdown table: a row a configuration, success rate and manipulation score of every task
    and level."""
    cells = [(task, level) for task in TASKS for level in LEVELS]
    heads = [f"{task}, level {level}: {what}" for task, level in cells for what in ("SR", "MS")]
    out = [
        "| configuration | seeds | " + " | ".join(heads) + " |",
        "|---|---:|" + "---|" * len(heads),
    ]
    for config in CONFIGS:
        values = []
        for task, level in cells:
            rate, manipulation = scores(runs, config, task, level)
            low, high = bootstrap(manipulation) if manipulation else (float("nan"),) * 2
            mean = f"{np.mean(manipulation):.0f} ({low:.0f}-{high:.0f})" if manipulation else "-"
            values += [str(rate), mean]
        seeds = [str(run.seed) for run in runs if run.config == config]
        out.append(f"| `{config}` | {', '.join(seeds) or '-'} | " + " | ".join(values) + " |")
    return "\n".join(out)


def plot(runs: Sequence[Run], path: Path) -> None:
    """Validation error against steps, a line a run, and success rates with their intervals."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(10, 3.6), layout="constrained", width_ratios=(2, 3)
    )
    cells = [(task, level) for task in TASKS for level in LEVELS]
    for number, config in enumerate(CONFIGS):
        color = f"C{number}"
        for run in runs:
            if run.config == config:
                left.plot(
                    [r["step"] for r in run.validated],
                    [r["validation_error"] for r in run.validated],
                    color=color,
                    marker=".",
                )
        rates = [scores(runs, config, *cell)[0] for cell in cells]
        middle, (low, high) = (
            np.array([r.percent for r in rates]),
            np.array([r.interval for r in rates]).T,
        )
        at = np.arange(len(cells)) + 0.25 * (number - 1)
        error = [np.maximum(middle - low, 0), np.maximum(high - middle, 0)]
        right.bar(at, middle, 0.22, yerr=error, capsize=3, color=color, label=config)
    left.set(xlabel="step", ylabel="error on validation episodes (rad)", yscale="log")
    right.set(
        xticks=np.arange(len(cells)),
        xticklabels=[f"{t}\nlevel {n}" for t, n in cells],
        ylabel="success rate (%)",
        ylim=(0, 100),
    )
    right.legend(fontsize=8)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def page(out: Path) -> None:
    """Write table and plot into docs/measurements/training.md."""
    runs = read_runs(out)
    plot(runs, DOCS / "training_study.png")
    codes = ", ".join(sorted({run.made["code"] for run in runs}))
    where = runs[-1].made["hardware"].split(", load")[0]
    steps = max((row["step"] for run in runs for row in run.validated), default=0)
    head = (
        f"{steps} steps; per cent over all seeds (95 % intervals clustered by scene); evaluated by"
        f" code {codes}; {where}."
    )
    text = f"{head}\n\n{table(runs)}\n\n![Validation error and success rate](../training_study.png)"
    docs = DOCS / "measurements" / "training.md"
    docs.write_text(inserted(docs.read_text(), text, BEGIN, END))


def main() -> None:
    """Run the study, or write its page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("run", "page"))
    parser.add_argument("--data", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--configs", default=",".join(CONFIGS))
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--episodes", type=int, default=20)
    given = parser.parse_args()
    if given.what == "page":
        page(given.out)
        return
    if given.data is None:
        parser.error("run wants --data")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    seeds = [int(seed) for seed in given.seeds.split(",")]
    run(
        given.data.absolute(),
        given.out.absolute(),
        given.configs.split(","),
        seeds,
        given.steps,
        given.episodes,
    )


if __name__ == "__main__":
    main()

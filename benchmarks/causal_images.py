"""The study of docs/science/preregistration_images.md: what a policy from images learns from three
kinds of demonstrations.

python -m benchmarks.causal_images run DIR [--rows FILE] makes what is missing, one unit after
another; the same command resumes python -m benchmarks.causal_images report [--rows FILE] tables of
docs/science/causal_images.md, and its figure

DIR/data/TASK/ARM holds the demonstrations; where an export is there already, it is used as it is. A
row of FILE is one network on the scenes of one level: {"task", "n", "seed", "arm", "inputs",
"level", "tried", "solved"}, scenes by seed.
"""

import itertools
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.causal_contrasts import LEVELS, Contrast, Side
from benchmarks.causal_tables import (
    Rates,
    Row,
    add_missing,
    command_line,
    fill_in,
    percent,
    read,
    table,
)
from benchmarks.study.rows import markdown

HERE = Path(__file__).parents[1]
ROWS, PAGE = (
    HERE / "docs" / "science" / f"causal_images{suffix}" for suffix in ("_rows.jsonl", ".md")
)
TASKS, ARMS, INPUTS = (
    ("click_bell", "adjust_bottle"),
    ("planned", "reactive", "corrected"),
    ("history", "none"),
)
CONFIGS = {"history": "puma-small", "none": "puma-small-no-history"}
N, SCENES, SCENE_SEED, CORRECTION_SEED = 100, 40, 3, 5
PRIMARY = (("reactive", "history"), ("planned", "history"), ("reactive", "none"))
OTHERS = (("corrected", "history"), ("planned", "none"), ("corrected", "none"))
BLOCKS = ((PRIMARY, (1, 2)), (OTHERS, (1,)), (PRIMARY, (3,)), (OTHERS, (2, 3)))
GIVEN_UP = 3
"""Exit code of a build that could not fill every slot."""


@dataclass(frozen=True)
class ImageUnit:
    """One network: the task, the arm whose demonstrations it learns from, what it sees of the past,
    and its seed."""

    task: str
    arm: str
    inputs: str
    seed: int


def units() -> Iterator[ImageUnit]:
    """All networks in the order of the pre-registration."""
    for task, (sides, seeds) in itertools.product(TASKS, BLOCKS):
        for seed, side in itertools.product(seeds, sides):
            yield ImageUnit(task, *side, seed)


class ImageStudy:
    """What is made below a directory; everything is made once."""

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()

    def rows(self, unit: ImageUnit) -> Iterator[Row]:
        """A network on the scenes of each level."""
        folder, levels = self.network(unit), ",".join(map(str, LEVELS))
        words = [
            "eval",
            str(folder),
            "--tasks",
            unit.task,
            "--embodiment",
            "aloha",
            "--levels",
            levels,
            "--episodes",
            str(SCENES),
        ]
        words += [
            "--seed",
            str(SCENE_SEED),
            "--manifests",
            str(self.root / "manifests"),
            "--executor",
            "inline",
        ]
        words += ["--out", str(folder / "evaluation"), "--quiet", "--json"]
        for cell in json.loads(call("training.puma.cli", words))["results"]:
            yield {
                **asdict(unit),
                "n": N,
                "level": cell["level"],
                "tried": cell["episodes"],
                "solved": cell["solved_seeds"],
            }

    def network(self, unit: ImageUnit) -> Path:
        """The directory of a trained network."""
        folder = self.root / "networks" / unit.task / f"{unit.arm}-{unit.inputs}-{unit.seed}"
        if policies(folder):
            return folder
        words = ["train", "--config", CONFIGS[unit.inputs], "--out", str(folder), "--quiet"]
        words += ["--set", f"data.cache={self.root / 'cache'}", "--set", f"train.seed={unit.seed}"]
        for shown in ["reactive", "corrected"] if unit.arm == "corrected" else [unit.arm]:
            words += ["--data", str(self.demonstrations(unit.task, shown))]
        call("training.puma.cli", words)
        return folder

    def demonstrations(self, task: str, arm: str) -> Path:
        """A dataset with its export. Corrections are those of the reactive network of seed 0 with
        history."""
        folder = self.root / "data" / task / arm
        if not (folder / "exports" / "parquet").exists():
            words = [
                "build",
                "--manifest",
                str(HERE / "manifests" / "puma-small.yaml"),
                "--tasks",
                task,
                "--out",
                str(folder),
            ]
            if arm == "planned":
                words += ["--expert", "planned"]
            if arm == "corrected":
                [policy] = policies(self.network(ImageUnit(task, "reactive", "history", 0)))
                words += ["--seed", str(CORRECTION_SEED), "--corrections", str(policy)]
            call("pipeline.cli", [*words, "--workers", "1", "--quiet"], (0, GIVEN_UP))
            call("pipeline.cli", ["export", str(folder), "--format", "parquet", "--quiet"])
        return folder


def policies(run: Path) -> list[Path]:
    """The policy of a run that is finished: it has one checkpoint, at its last step."""
    return list(run.glob("checkpoints/*/policy.py"))


def call(module: str, words: Sequence[str], fine: Sequence[int] = (0,)) -> str:
    """What a command of the project prints. Raises CalledProcessError."""
    done = subprocess.run(
        [sys.executable, "-m", module, *words], check=False, stdout=subprocess.PIPE, text=True
    )
    if done.returncode not in fine:
        raise subprocess.CalledProcessError(done.returncode, done.args)
    return done.stdout


def pairs(task: str) -> tuple[list[Contrast], list[Contrast]]:
    """The primary contrasts of a task, and the secondary ones: all are secondary on the second
    task."""

    def contrast(level: int, first: tuple[str, str], second: tuple[str, str]) -> Contrast:
        return Contrast(task, level, Side(first[0], N, first[1]), Side(second[0], N, second[1]))

    reactive, planned, alone = PRIMARY
    corrected, planned_alone, corrected_alone = OTHERS
    first = [
        contrast(level, *two)
        for two in ((reactive, planned), (reactive, alone))
        for level in LEVELS
    ]
    others = (
        (corrected, reactive),
        (planned, planned_alone),
        (corrected, corrected_alone),
        (alone, planned_alone),
    )
    second = [contrast(level, *two) for two in others for level in LEVELS]
    return (first, second) if task == TASKS[0] else ([], first + second)


def report(rows: Path, page: Path) -> None:
    """Write tables and figure of the page."""
    held = read(rows)
    tasks = [task for task in TASKS if any(row["task"] == task for row in held)]
    primary, secondary = ([c for task in tasks for c in pairs(task)[k]] for k in (0, 1))
    fill_in(page, "contrasts", table(held, primary, (("secondary", secondary),)))
    head = (
        "arm",
        "networks",
        *(f"level {level}: SR % (95 %)" for level in LEVELS),
        "each network alone",
    )
    fill_in(page, "success", markdown(head, list(success(held, tasks))))
    draw(held, tasks, page.with_suffix(".png"))


def success(rows: Sequence[Row], tasks: Sequence[str]) -> Iterator[list[object]]:
    """A line for each arm that has networks: their number, the success of all at each level, and
    that of each of them."""
    for task, inputs, arm in itertools.product(tasks, INPUTS, ARMS):
        side, rates = Side(arm, N, inputs), [Rates(rows, task, level) for level in LEVELS]
        if seeds := rates[0].seeds(side):
            cells = ("{:.0f} ({:.0f}-{:.0f})".format(*percent(r, side)) for r in rates)
            alone = zip(*(100 * r.each(side)[0].mean(1) for r in rates), strict=True)
            yield [
                f"{task}: {arm}, {inputs}",
                len(seeds),
                *cells,
                ", ".join(f"{one:.0f}/{other:.0f}" for one, other in alone),
            ]


def draw(rows: Sequence[Row], tasks: Sequence[str], plot: Path) -> None:
    """Success by arm, a bar for each of its inputs, a panel for each task and level."""
    size = (7.5, 2.8 * len(tasks))
    figure, panels = plt.subplots(
        len(tasks), len(LEVELS), figsize=size, sharey=True, squeeze=False, layout="constrained"
    )
    for (task, level), ax in zip(itertools.product(tasks, LEVELS), panels.flat, strict=True):
        rates = Rates(rows, task, level)
        for number, inputs in enumerate(INPUTS):
            sides = [
                (place + 0.4 * number - 0.2, Side(arm, N, inputs)) for place, arm in enumerate(ARMS)
            ]
            there = [(place, *percent(rates, side)) for place, side in sides if rates.seeds(side)]
            if there:
                places, means, low, high = np.array(there).T
                ax.bar(
                    places,
                    means,
                    0.36,
                    yerr=[means - low, high - means],
                    capsize=2,
                    color=f"C{number}",
                    label=inputs,
                )
        ax.set_xticks(range(len(ARMS)), ARMS)
        ax.set(title=f"{task}, level {level}", xlim=(-0.5, len(ARMS) - 0.5), ylim=(0, 100))
    for ax in panels[:, 0]:
        ax.set_ylabel("success (%)")
    panels[0, -1].legend(fontsize=7)
    figure.savefig(plot, dpi=120)
    plt.close(figure)


def run(root: Path, rows: Path) -> None:
    """Make the rows that are missing."""
    add_missing(rows, units(), ImageStudy(root).rows)


if __name__ == "__main__":
    command_line(__doc__, ROWS, run, lambda rows: report(rows, PAGE))

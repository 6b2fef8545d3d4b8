"""The study of docs/science/preregistration_images.md: what a policy from images learns from three kinds of demonstrations.

python -m benchmarks.causal_images run DIR [--rows FILE]   makes what is missing, one unit after another; the same command resumes
python -m benchmarks.causal_images report [--rows FILE]    tables of docs/science/causal_images.md, and its figure

DIR/data/TASK/KIND holds the demonstrations; where an export is there already, it is used as it is. A row of FILE is one network on
the scenes of one level: {"task", "n", "seed", "arm", "level", "tried", "solved"}, scenes by seed.
"""

import argparse
import itertools
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.causal_tables import LEVELS, Rates, Row, Side, differences, fill_in, read
from benchmarks.study.rows import markdown
from pipeline.evaluate.difference import interval

HERE = Path(__file__).parents[1]
ROWS, PAGE = (HERE / "docs" / "science" / f"causal_images{suffix}" for suffix in ("_rows.jsonl", ".md"))
TASKS, KINDS, SIGHTS = ("click_bell", "adjust_bottle"), ("planned", "reactive", "corrected"), ("history", "none")
CONFIGS = {"history": "puma-small", "none": "puma-small-no-history"}
N, SCENES, SCENE_SEED, CORRECTION_SEED = 100, 40, 3, 5
PRIMARY = (("reactive", "history"), ("planned", "history"), ("reactive", "none"))
OTHERS = (("corrected", "history"), ("planned", "none"), ("corrected", "none"))
BLOCKS = ((PRIMARY, (1, 2)), (OTHERS, (1,)), (PRIMARY, (3,)), (OTHERS, (2, 3)))
GIVEN_UP = 3
"""Exit code of a build that could not fill every slot."""


@dataclass(frozen=True)
class Unit:
    """One network: the task, the kind of demonstrations it learns from, what it sees of the past, and its seed."""

    task: str
    kind: str
    sight: str
    seed: int

    @property
    def arm(self) -> str:
        """The name of its arm in rows and tables."""
        return arm(self.kind, self.sight)


def arm(kind: str, sight: str) -> str:
    """The name of an arm."""
    return f"{kind}, {'with' if sight == 'history' else 'no'} history"


def units() -> Iterator[Unit]:
    """All networks in the order of the pre-registration."""
    for task, (arms, seeds) in itertools.product(TASKS, BLOCKS):
        for seed, (kind, sight) in itertools.product(seeds, arms):
            yield Unit(task, kind, sight, seed)


class Study:
    """What is made below a directory; everything is made once."""

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()

    def rows(self, unit: Unit) -> Iterator[Row]:
        """A network on the scenes of each level."""
        folder, levels = self.network(unit), ",".join(map(str, LEVELS))
        words = ["eval", str(folder), "--tasks", unit.task, "--embodiment", "aloha", "--levels", levels, "--episodes", str(SCENES)]
        words += ["--seed", str(SCENE_SEED), "--manifests", str(self.root / "manifests"), "--executor", "inline"]
        words += ["--out", str(folder / "evaluation"), "--quiet", "--json"]
        for cell in json.loads(call("training.puma.cli", words))["results"]:
            key = {"task": unit.task, "n": N, "seed": unit.seed, "arm": unit.arm}
            yield {**key, "level": cell["level"], "tried": cell["episodes"], "solved": sorted(cell["solved_seeds"])}

    def network(self, unit: Unit) -> Path:
        """The directory of a trained network."""
        folder = self.root / "networks" / unit.task / f"{unit.kind}-{unit.sight}-{unit.seed}"
        if policies(folder):
            return folder
        shown = ["reactive", "corrected"] if unit.kind == "corrected" else [unit.kind]
        words = ["train", "--config", CONFIGS[unit.sight], "--out", str(folder), "--quiet"]
        words += ["--set", f"data.cache={self.root / 'cache'}", "--set", f"train.seed={unit.seed}"]
        for kind in shown:
            words += ["--data", str(self.demonstrations(unit.task, kind))]
        call("training.puma.cli", words)
        return folder

    def demonstrations(self, task: str, kind: str) -> Path:
        """A dataset with its export. Corrections are those of the reactive network of seed 0 with history."""
        folder = self.root / "data" / task / kind
        if not (folder / "exports" / "parquet").exists():
            words = ["build", "--manifest", str(HERE / "manifests" / "puma-small.yaml"), "--tasks", task, "--out", str(folder)]
            if kind == "planned":
                words += ["--expert", "planned"]
            if kind == "corrected":
                [policy] = policies(self.network(Unit(task, "reactive", "history", 0)))
                words += ["--seed", str(CORRECTION_SEED), "--corrections", str(policy)]
            call("pipeline.cli", [*words, "--workers", "1", "--quiet"], (0, GIVEN_UP))
            call("pipeline.cli", ["export", str(folder), "--format", "parquet", "--quiet"])
        return folder


def policies(run: Path) -> list[Path]:
    """The policy of a run that is finished: it has one checkpoint, at its last step."""
    return list(run.glob("checkpoints/*/policy.py"))


def call(module: str, words: Sequence[str], fine: Sequence[int] = (0,)) -> str:
    """What a command of the project prints. Raises CalledProcessError."""
    done = subprocess.run([sys.executable, "-m", module, *words], check=False, stdout=subprocess.PIPE, text=True)
    if done.returncode not in fine:
        raise subprocess.CalledProcessError(done.returncode, done.args)
    return done.stdout


def run(root: Path, rows: Path) -> None:
    """Do the units that are missing in `rows`."""
    done = {(row["task"], row["arm"], row["seed"]) for row in found(rows)}
    study = Study(root)
    for unit in units():
        if (unit.task, unit.arm, unit.seed) not in done:
            new = "".join(json.dumps(row) + "\n" for row in study.rows(unit))
            with rows.open("a") as file:
                file.write(new)
            print(unit, flush=True)


def found(rows: Path) -> list[Row]:
    """The rows that are there."""
    return read(rows) if rows.exists() else []


def contrasts(task: str) -> dict[str, list[tuple[str, str]]]:
    """The pairs of arms of a task: those of the primary contrasts on the first task, and the others."""
    first = [(arm("reactive", "history"), arm("planned", "history")), (arm("reactive", "history"), arm("reactive", "none"))]
    second = [
        (arm("corrected", "history"), arm("reactive", "history")),
        *((arm(kind, "history"), arm(kind, "none")) for kind in ("planned", "corrected")),
        (arm("reactive", "none"), arm("planned", "none")),
    ]
    return {"primary": first, "secondary": second} if task == TASKS[0] else {"primary": [], "secondary": first + second}


def holm(chances: Sequence[float], tests: int) -> list[float]:
    """p corrected by Holm's method for so many tests; those that are missing count as the largest."""
    order, out, least = np.argsort(chances, kind="stable"), [0.0] * len(chances), 0.0
    for rank, i in enumerate(order):
        least = out[i] = max(least, min(1.0, (tests - rank) * chances[i]))
    return out


def report(rows: Path, page: Path) -> None:
    """Write tables and figure of the page."""
    held = found(rows)
    head = ["contrast", "networks an arm", "first", "second", "difference (points)", "p"]
    lines, chances = dict[str, list[list[object]]](), dict[str, list[float]]()
    for name in ("primary", "secondary"):
        wanted = [
            (task, level, (one, N), (other, N))
            for task, level in itertools.product(TASKS, LEVELS)
            for one, other in contrasts(task)[name]
        ]
        some = list(differences(held, wanted))
        lines[name], chances[name] = [line for line, _ in some], [p for _, p in some]
    corrected = holm(chances["primary"], len(LEVELS) * len(contrasts(TASKS[0])["primary"]))
    primary = [[*line, f"{p:.2g}"] for line, p in zip(lines["primary"], corrected, strict=True)]
    fill_in(page, "primary", markdown([*head, "p, Holm"], primary))
    fill_in(page, "secondary", markdown(head, lines["secondary"]))
    tasks = [task for task in TASKS if any(row["task"] == task for row in held)]
    table = list(success(held, tasks))
    columns = ("arm", "networks", *(f"level {level}: SR % (95 %)" for level in LEVELS), "of one network each")
    fill_in(page, "success", markdown(columns, table))
    plot(held, tasks, page.with_suffix(".png"))


def success(rows: Sequence[Row], tasks: Sequence[str]) -> Iterator[list[object]]:
    """A line for each arm that has networks: their number, the success of all at each level, and that of each of them."""
    for task, sight, kind in itertools.product(tasks, SIGHTS, KINDS):
        side: Side = (arm(kind, sight), N)
        rates = [Rates(rows, task, level) for level in LEVELS]
        if not (seeds := rates[0].seeds(side)):
            continue
        cells = [f"{100 * scenes.mean():.0f} ({low:.0f}-{high:.0f})" for scenes, low, high in (of_side(r, side) for r in rates)]
        alone = [
            "/".join(f"{100 * len(row['solved']) / row['tried']:.0f}" for row in rows_of(rows, task, side[0], seed))
            for seed in seeds
        ]
        yield [f"{task}: {side[0]}", len(seeds), *cells, ", ".join(alone)]


def rows_of(rows: Sequence[Row], task: str, name: str, seed: int) -> list[Row]:
    """The rows of one network, by level."""
    mine = [row for row in rows if (row["task"], row["arm"], row["seed"]) == (task, name, seed)]
    return sorted(mine, key=lambda row: row["level"])


def of_side(rates: Rates, side: Side) -> tuple[np.ndarray, float, float]:
    """Success by scene of an arm, and the 95 % interval of its mean, per cent."""
    [scenes] = rates.of(side)
    low, high = interval({"": scenes})
    return scenes, max(0.0, 100 * low), min(100.0, 100 * high)


def plot(rows: Sequence[Row], tasks: Sequence[str], path: Path) -> None:
    """Success by kind of demonstrations, a bar for each sight, a panel for each task and level."""
    figure, panels = plt.subplots(
        len(tasks), len(LEVELS), figsize=(7.5, 2.8 * len(tasks)), sharey=True, squeeze=False, layout="constrained"
    )
    for (task, level), ax in zip(itertools.product(tasks, LEVELS), panels.flat, strict=True):
        rates = Rates(rows, task, level)
        for number, sight in enumerate(SIGHTS):
            sides = [(place, (arm(kind, sight), N)) for place, kind in enumerate(KINDS)]
            there = [(place, *of_side(rates, side)) for place, side in sides if rates.seeds(side)]
            if there:
                means = np.array([100 * scenes.mean() for _, scenes, _, _ in there])
                bars = np.maximum([means - [low for *_, low, _ in there], [high for *_, high in there] - means], 0)
                places = [place + 0.4 * number - 0.2 for place, *_ in there]
                ax.bar(places, means, 0.36, yerr=bars, capsize=2, color=f"C{number}", label=("with history", "one image")[number])
        ax.set_xticks(range(len(KINDS)), KINDS)
        ax.set(title=f"{task}, level {level}", xlim=(-0.5, len(KINDS) - 0.5), ylim=(0, 100))
    for ax in panels[:, 0]:
        ax.set_ylabel("success (%)")
    panels[0, -1].legend(fontsize=7)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    for verb in ("run", "report"):
        doing = verbs.add_parser(verb)
        if verb == "run":
            doing.add_argument("root", type=Path)
        doing.add_argument("--rows", type=Path, default=ROWS)
    given = parser.parse_args()
    if given.verb == "run":
        run(given.root, given.rows)
    else:
        report(given.rows, PAGE)


if __name__ == "__main__":
    main()

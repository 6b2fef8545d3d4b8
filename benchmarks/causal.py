"""The study of docs/science/preregistration.md: what networks learn from planned and reactive demonstrations, and from corrections.

python -m benchmarks.causal run DIR [--rows FILE]      makes what is missing, one unit after another; the same command resumes
python -m benchmarks.causal report FILE PAGE.md PLOT.png

A row of FILE is one network on the scenes of one level: {"task", "n", "arm", "seed", "level", "tried", "solved"}, scenes by seed.
"""

import argparse
import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.study.rows import markdown
from pipeline.data.recipe.model import Recipe
from pipeline.data.rules import Corrections
from pipeline.evaluate.case import blind
from pipeline.evaluate.difference import interval, sign_flip
from pipeline.evaluate.evaluate import evaluate, inline
from pipeline.run.evaluation import evaluation_version
from pipeline.run.identity.slot_keys import code_version
from training.ladder.climb import Ladder, evaluation, train_missing
from training.ladder.demonstrations import Demonstration, make_demonstrations
from training.ladder.network import Settings
from training.ladder.policy import LadderForm

TASKS, SIZES, ARMS, SEEDS, LEVELS, SCENES = (
    ("click_bell", "grab_roller"),
    (50, 150),
    ("planned", "reactive", "takeovers"),
    3,
    (1, 3),
    40,
)
SETTINGS = Settings(inputs="velocity", chunk=8, steps=4000)
EXECUTE = 4
CONTRASTS = (("reactive", "planned"), ("takeovers", "planned"), ("reactive", "takeovers"))

Row = dict[str, Any]


@dataclass(frozen=True)
class Unit:
    """One network: it learns from `n` episodes a level."""

    task: str
    n: int
    seed: int
    arm: str


def units() -> Iterator[Unit]:
    """All networks in the order of the pre-registration."""
    for task, n, seed, arm in itertools.product(TASKS, SIZES, range(SEEDS), ARMS):
        yield Unit(task, n, seed, arm)


class Study:
    """What is made below DIR; everything is made once."""

    def __init__(self, root: Path) -> None:
        self.root, self.code, self.physics = root, evaluation_version(), code_version()

    def rows(self, unit: Unit) -> Iterator[Row]:
        """A network on the scenes of each level."""
        path = self.network(self.shown(unit), unit)
        recipe = self.recipe(unit.task, SCENES)
        ladder = Ladder(recipe, ("velocity",), ((SETTINGS.chunk, EXECUTE),), SEEDS, SCENES, code=self.code)
        wanted = evaluation(ladder, unit.task, LadderForm().name(f"ladder:{path}?execute={EXECUTE}"), blind(recipe))
        outcome = evaluate(wanted, self.root / "evaluations", inline)
        manifest = {cell["level"]: cell for cell in outcome.cells}
        for level in LEVELS:
            cell = manifest[level]
            yield {**vars(unit), "level": level, "tried": cell["episodes"], "solved": sorted(cell["solved_seeds"])}

    def network(self, shown: Sequence[Demonstration], unit: Unit) -> Path:
        """The file of a trained network."""
        return train_missing(shown, replace(SETTINGS, seed=unit.seed), self.root / "networks" / unit.task)

    def shown(self, unit: Unit) -> list[Demonstration]:
        """What the network of a unit learns from."""
        recipe, half = self.recipe(unit.task, unit.n), self.recipe(unit.task, unit.n // 2)
        if unit.arm != "takeovers":
            return self.demonstrate(recipe.model_copy(update={"expert": unit.arm}))
        planned = self.demonstrate(half)
        name = LadderForm().name(f"ladder:{self.network(planned, replace(unit, seed=0))}?execute={EXECUTE}")
        return [
            *planned,
            *self.demonstrate(half.model_copy(update={"corrections": Corrections(policy=name.text, label=name.label)})),
        ]

    def demonstrate(self, recipe: Recipe) -> list[Demonstration]:
        """The demonstrations of a recipe."""
        return list(make_demonstrations(recipe, self.root / "demonstrations" / self.physics[:12] / recipe.label, inline))

    def recipe(self, task: str, n: int) -> Recipe:
        """Planned demonstrations."""
        return Recipe(tasks=(task,), levels=LEVELS, episodes=n)


def run(root: Path, rows: Path) -> None:
    """Do the units that are missing in `rows`."""
    root.mkdir(parents=True, exist_ok=True)
    found = read(rows) if rows.exists() else []
    done, study = {tuple(row[key] for key in ("task", "n", "seed", "arm")) for row in found}, Study(root)
    for unit in units():
        if (unit.task, unit.n, unit.seed, unit.arm) not in done:
            new = "".join(json.dumps(row) + "\n" for row in study.rows(unit))
            with rows.open("a") as file:
                file.write(new)
            print(unit, flush=True)


def read(rows: Path) -> list[Row]:
    """The rows of a file."""
    return [json.loads(line) for line in rows.read_text().splitlines()]


def by_scene(rows: Sequence[Row], seeds: Sequence[int], scenes: Sequence[int]) -> np.ndarray:
    """Mean success (S,) of each scene over networks of these seeds."""
    return np.mean([[scene in row["solved"] for scene in scenes] for row in rows if row["seed"] in seeds], axis=0)


def contrasts(rows: Sequence[Row]) -> list[list[object]]:
    """A line for each contrast that has a seed in both arms: the rates and the difference in points, with its interval and p.

    Scenes that no network solved are the same in both arms: they count as so many differences of 0.
    """
    lines: list[list[object]] = []
    for task, n, level, (first, second) in itertools.product(TASKS, SIZES, LEVELS, CONTRASTS):
        arms = [[r for r in rows if (r["task"], r["n"], r["level"], r["arm"]) == (task, n, level, a)] for a in (first, second)]
        seeds = sorted({r["seed"] for r in arms[0]} & {r["seed"] for r in arms[1]})
        if not seeds:
            continue
        scenes, tried = sorted({s for arm in arms for r in arm for s in r["solved"]}), arms[0][0]["tried"]
        one, other = (np.append(by_scene(arm, seeds, scenes), np.zeros(tried - len(scenes))) for arm in arms)
        low, high = interval({task: one - other})
        p = sign_flip([round(d) for d in (one - other) * len(seeds)])
        effect = f"{100 * np.mean(one - other):+.0f} ({100 * low:+.0f} to {100 * high:+.0f})"
        rates = (f"{100 * one.mean():.0f} %", f"{100 * other.mean():.0f} %")
        lines.append([f"{task}, level {level}, N = {n}: {first} - {second}", len(seeds), *rates, effect, f"{p:.2g}"])
    return lines


def report(rows: Path, page: Path, plot: Path) -> None:
    """Write the table into PAGE.md, between its marks, and the curves into PLOT.png."""
    found = read(rows)
    table = markdown(("contrast", "networks an arm", "first", "second", "difference (points)", "p"), contrasts(found))
    text = page.read_text()
    begin, end = "<!-- contrasts -->\n", "<!-- end -->"
    page.write_text(text[: text.index(begin) + len(begin)] + table + "\n" + text[text.index(end) :])
    figure, axes = plt.subplots(1, len(LEVELS), figsize=(8, 3), sharey=True, layout="constrained")
    for ax, level in zip(axes, LEVELS, strict=True):
        for task, arm in itertools.product(TASKS, ARMS):
            mine = [r for r in found if (r["task"], r["arm"], r["level"]) == (task, arm, level)]
            sizes = sorted({r["n"] for r in mine})
            rates = [100 * np.mean([len(r["solved"]) / r["tried"] for r in mine if r["n"] == n]) for n in sizes]
            if sizes:
                ax.plot(sizes, rates, "o-" if task == TASKS[0] else "s--", color=f"C{ARMS.index(arm)}", label=f"{task}, {arm}")
        ax.set(title=f"level {level}", xlabel="demonstrations a level", ylim=(0, 100))
    axes[0].set_ylabel("success (%)")
    axes[-1].legend(fontsize=7)
    figure.savefig(plot, dpi=120)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    doing = verbs.add_parser("run")
    doing.add_argument("root", type=Path)
    doing.add_argument("--rows", type=Path, default=Path("docs/science/causal_rows.jsonl"))
    telling = verbs.add_parser("report")
    for name in ("rows", "page", "plot"):
        telling.add_argument(name, type=Path)
    given = parser.parse_args()
    if given.verb == "run":
        run(given.root, given.rows)
    else:
        report(given.rows, given.page, given.plot)


if __name__ == "__main__":
    main()

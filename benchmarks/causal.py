"""The study of docs/science/preregistration.md: what networks learn from planned and reactive
demonstrations, and from corrections.

python -m benchmarks.causal run DIR [--rows FILE] makes what is missing, one unit after another; the
same command resumes python -m benchmarks.causal explore DIR [--rows FILE] the same for the
exploratory units, of the first, third and fourth addendum python -m benchmarks.causal widen DIR
[--rows FILE] the same for those of the second: more tasks, data and inputs python -m
benchmarks.causal report FILE PAGE.md PLOT.png python -m benchmarks.causal describe DIR FILE PAGE.md
what the demonstrations of the rows look like

A row of FILE is one network on the scenes of one level: {"task", "n", "arm", "seed", "inputs",
"level", "tried", "solved"}, scenes by seed. Rows without "inputs" are of networks that see the
target's velocity.
"""

import argparse
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.causal_contrasts import (
    ARMS,
    HOLDING,
    LARGEST,
    LEVELS,
    MORE_SIZES,
    SEEDS,
    SIZES,
    TASKS,
    WIDENED,
)
from benchmarks.causal_tables import Row, add_missing, fill_in, read, report
from benchmarks.foresighted import fill_foreseen
from benchmarks.study.rows import markdown
from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Contact, Corrections
from pipeline.evaluate.evaluate import evaluate
from pipeline.evaluate.scenes.case import blind
from pipeline.evaluate.scenes.manifests import inline
from pipeline.run.evaluation import evaluation_version
from pipeline.run.identity.core import code_version
from training.ladder.climb import Ladder, evaluation
from training.ladder.demonstrations import Demonstration, make_demonstrations
from training.ladder.network import Settings
from training.ladder.policy import LadderForm
from training.ladder.training import train_missing

SETTINGS = Settings(inputs="velocity", chunk=8, steps=4000)
EXECUTE, FPS = 4, 15
EXPLORED = (
    *((n, "foresighted", seed) for n in (150, 50) for seed in range(SEEDS)),
    *(
        (n, arm, seed)
        for n in MORE_SIZES
        for seed in range(SEEDS)
        for arm in ("planned", "reactive")
    ),
    *((max(SIZES), "new scenes", seed) for seed in range(SEEDS)),
    *((LARGEST, arm, seed) for seed in range(SEEDS) for arm in ("planned", "reactive")),
)
"""The networks of the first, third and fourth addendum that see the velocity, on the first task, in
their order."""
OTHER_SEED = 1
"""What is added to the seed of a recipe for scenes that no other recipe here has."""


@dataclass(frozen=True)
class Unit:
    """One network: it learns from `n` episodes a level."""

    task: str
    n: int
    seed: int
    arm: str
    inputs: str = SETTINGS.inputs


def units() -> Iterator[Unit]:
    """All networks in the order of the pre-registration."""
    for task, n, seed, arm in itertools.product(TASKS, SIZES, range(SEEDS), ARMS):
        yield Unit(task, n, seed, arm)


def explored() -> Iterator[Unit]:
    """The networks of the first and third addendum, and the larger ones of the fourth."""
    for n, arm, seed in EXPLORED:
        yield Unit(TASKS[0], n, seed, arm)
    for seed, arm in itertools.product(range(SEEDS), ARMS[:2]):
        yield Unit(TASKS[0], max(SIZES), seed, arm, HOLDING)


def widened() -> Iterator[Unit]:
    """The networks of the second addendum, except the third one that sees two frames: networks of
    today hold still first."""
    for seeds, (task, n, arms, inputs) in itertools.product(((0, 1), (2,)), WIDENED):
        for seed, arm in itertools.product(seeds, arms):
            if (inputs, seed) != ("two_frames", 2):
                yield Unit(task, n, seed, arm, inputs)


def _kind(inputs: str) -> str:
    """The rung of the ladder: networks that hold still first, as they do now, are those that once
    did not."""
    return "two_frames" if inputs == HOLDING else inputs


@dataclass(frozen=True)
class CausalScenes:
    """What networks are tried on: admitted scenes a level, their seed, and what the first touch
    does to the target."""

    levels: tuple[int, ...] = LEVELS
    count: int = 40
    seed: int = 0
    contact: Contact = "stop"


class Study:
    """What is made below DIR; everything is made once. `seed` is that of its demonstrations."""

    def __init__(self, root: Path, seed: int = 0) -> None:
        self.root, self.seed, self.code, self.physics = (
            root,
            seed,
            evaluation_version(),
            code_version(),
        )

    def rows(self, unit: Unit, scenes: CausalScenes = CausalScenes()) -> Iterator[Row]:
        """A network on the scenes of each level."""
        path = self.network(self.shown(unit), unit)
        recipe = self.recipe(unit.task, scenes.count).model_copy(update={"levels": scenes.levels})
        ladder = Ladder(
            recipe,
            (_kind(unit.inputs),),
            ((SETTINGS.chunk, EXECUTE),),
            SEEDS,
            scenes.count,
            code=self.code,
        )
        setup = blind(recipe).override(
            {"contact": scenes.contact} if scenes.contact != "stop" else {}
        )
        wanted = evaluation(
            ladder, unit.task, LadderForm().name(f"ladder:{path}?execute={EXECUTE}"), setup
        )
        outcome = evaluate(
            replace(wanted, seed=scenes.seed), self.root / "evaluations" / scenes.contact, inline
        )
        manifest = {cell["level"]: cell for cell in outcome.cells}
        for level in scenes.levels:
            cell = manifest[level]
            yield {
                **vars(unit),
                "level": level,
                "tried": cell["episodes"],
                "solved": sorted(cell["solved_seeds"]),
            }

    def network(self, shown: Sequence[Demonstration], unit: Unit) -> Path:
        """The file of a trained network."""
        return train_missing(
            shown,
            replace(SETTINGS, seed=unit.seed, inputs=_kind(unit.inputs)),
            self.root / "networks" / unit.task,
        )

    def shown(self, unit: Unit) -> list[Demonstration]:
        """What the network of a unit learns from."""
        recipe, half = self.recipe(unit.task, unit.n), self.recipe(unit.task, unit.n // 2)
        if unit.arm == "foresighted":
            return self.foresighted(unit.task, unit.n)
        if unit.arm == "half":
            return self.half_and_half(unit)
        if unit.arm == "static":
            return self.demonstrate(
                recipe.model_copy(update={"levels": (0,), "episodes": len(LEVELS) * unit.n})
            )
        if unit.arm not in ("takeovers", "new scenes"):
            return self.demonstrate(recipe.model_copy(update={"expert": unit.arm}))
        planned = self.demonstrate(half)
        name = LadderForm().name(
            f"ladder:{self.network(planned, replace(unit, seed=0))}?execute={EXECUTE}"
        )
        taken = half.model_copy(
            update={"corrections": Corrections(policy=name.text, label=name.label)}
        )
        if unit.arm == "new scenes":
            taken = taken.model_copy(update={"seed": self.seed + OTHER_SEED})
        return [*planned, *self.demonstrate(taken)]

    def half_and_half(self, unit: Unit) -> list[Demonstration]:
        """By level, planned demonstrations of the first half of the slots and reactive ones of the
        others."""
        planned = self.shown(replace(unit, arm="planned", n=unit.n // 2))
        former = self.shown(replace(unit, arm="reactive", n=unit.n // 2))
        reactive, out = self.shown(replace(unit, arm="reactive")), list[Demonstration]()
        for level in LEVELS:
            first, skipped, every = (
                [d for d in shown if d.cell.level == level] for shown in (planned, former, reactive)
            )
            out += first + every[len(skipped) :]
        return out

    def foresighted(self, task: str, n: int) -> list[Demonstration]:
        """The demonstrations of the expert that follows a target whose future it knows."""
        recipe = self.recipe(task, n).model_copy(update={"expert": "reactive"})
        return list(
            make_demonstrations(
                recipe,
                self.demonstrations / "foresighted",
                lambda _, jobs: inline(fill_foreseen, jobs),
            )
        )

    def demonstrate(self, recipe: Recipe) -> list[Demonstration]:
        """The demonstrations of a recipe."""
        folder = recipe.label + f"-seed{recipe.seed}" * (recipe.seed != 0)
        return list(make_demonstrations(recipe, self.demonstrations / folder, inline))

    @property
    def demonstrations(self) -> Path:
        """The directory of demonstrations of this version of the program."""
        return self.root / "demonstrations" / self.physics[:12]

    def recipe(self, task: str, n: int) -> Recipe:
        """Planned demonstrations."""
        return Recipe(tasks=(task,), levels=LEVELS, episodes=n, seed=self.seed)


def describe(root: Path, page: Path, rows: Path) -> None:
    """Write into PAGE.md how the hands of each arm's demonstrations move, of the tasks that have
    rows: most have 150 a level."""
    study, lines = Study(root), list[list[object]]()
    sizes = {TASKS[0]: max(SIZES)} | {task: n for task, n, _, _ in WIDENED if task != TASKS[0]}
    found = {(row["task"], row["n"], row["arm"]) for row in read(rows)}
    for (task, n), arm in itertools.product(sizes.items(), ("planned", "foresighted", "reactive")):
        shown = study.shown(Unit(task, n, 0, arm)) if (task, n, arm) in found else []
        for level in LEVELS if shown else ():
            mine = [d for d in shown if d.cell.level == level]
            until, length, apart = np.median([approach(d) for d in mine], axis=0)
            again = np.mean([d.untouched > 1.5 * until * FPS for d in mine])
            numbers = (
                f"{until:.1f}",
                f"{100 * again:.0f} %",
                f"{length:.2f}",
                f"{1000 * apart:.0f}",
            )
            lines.append([task, level, arm, f"{len(mine)} of {n}", *numbers])
    columns = ("until the touch (s)", "longer by half", "path (m)", "speed off the target's (mm/s)")
    fill_in(page, "demonstrations", markdown(("task", "level", "arm", "episodes", *columns), lines))


def approach(d: Demonstration) -> tuple[float, float, float]:
    """Of the hand that is nearest to the target at the touch: seconds and metres until then, and
    its mean horizontal speed (m/s) relative to the target in the last half second."""
    end = d.untouched
    side = int(np.linalg.norm(d.tools[end - 1, :, :3] - d.poses[end - 1, :1, :3], axis=1).argmin())
    hand, target = d.tools[:end, side, :3], d.poses[:end, 0, :3]
    apart = np.diff((hand - target)[-1 - FPS // 2 :, :2], axis=0) * FPS
    length = np.linalg.norm(np.diff(hand, axis=0), axis=1).sum()
    return end / FPS, float(length), float(np.linalg.norm(apart, axis=1).mean())


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    wanted = {"run": units, "explore": explored, "widen": widened}
    for verb in wanted:
        doing = verbs.add_parser(verb)
        doing.add_argument("root", type=Path)
        doing.add_argument("--rows", type=Path, default=Path("docs/science/causal_rows.jsonl"))
    for verb, names in (
        ("report", ("rows", "page", "plot")),
        ("describe", ("root", "rows", "page")),
    ):
        telling = verbs.add_parser(verb)
        for name in names:
            telling.add_argument(name, type=Path)
    given = parser.parse_args()
    if given.verb == "report":
        report(given.rows, given.page, given.plot)
    elif given.verb == "describe":
        describe(given.root, given.page, given.rows)
    else:
        given.root.mkdir(parents=True, exist_ok=True)
        add_missing(given.rows, wanted[given.verb](), Study(given.root).rows)


if __name__ == "__main__":
    main()

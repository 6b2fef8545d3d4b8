"""The repetition of the study of states with new demonstrations, networks and scenes: fourth
addendum of preregistration.md.

python -m benchmarks.causal_repeat run DIR [--rows FILE] makes what is missing, one unit after
another; the same command resumes python -m benchmarks.causal_repeat report [--rows FILE] tables of
docs/science/causal_repeat.md, and its figure

A row of FILE is one network on the scenes of one level, as in benchmarks/causal.py, and `contact`,
what the first touch does.
"""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib.pyplot as plt

from benchmarks.causal import CausalScenes, Study, Unit
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
from pipeline.evaluate.scoring.statistics import interval

HERE = Path(__file__).parents[1]
ROWS, PAGE = (
    HERE / "docs" / "science" / f"causal_repeat{suffix}" for suffix in ("_rows.jsonl", ".md")
)
TASKS = (
    "click_bell",
    "press_stapler",
    "beat_block_hammer",
    "grab_roller",
    "move_can_pot",
    "place_mouse_pad",
)
HELD, N, SEED = TASKS[:5], 150, 2
STOP, HOLD = CausalScenes((0, *LEVELS), 100, 1), CausalScenes(LEVELS, 100, 1, "hold")
PAIR, OTHERS = ("planned", "reactive"), ("half", "new scenes", "static")


def units() -> Iterator[Unit]:
    """All networks in the order of the addendum."""
    for seeds in ((0, 1), (2, 3, 4)):
        for task, seed, arm in itertools.product(TASKS, seeds, PAIR):
            yield Unit(task, N, seed, arm)
        for seed, arm in itertools.product(seeds, OTHERS):
            yield Unit(TASKS[0], N, seed, arm)


def tried(study: Study, unit: Unit) -> Iterator[Row]:
    """A network on all its scenes."""
    for scenes in (STOP, HOLD) if unit.task in HELD and unit.arm in PAIR else (STOP,):
        yield from (row | {"contact": scenes.contact} for row in study.rows(unit, scenes))


def pairs(levels: Sequence[int], tasks: Sequence[str]) -> Iterator[Contrast]:
    """Reactive minus planned."""
    for task, level in itertools.product(tasks, levels):
        yield Contrast(task, level, Side("reactive", N), Side("planned", N))


def others() -> Iterator[Contrast]:
    """Contrasts of the other arms, on the first task."""
    named = (
        ("half", "planned"),
        ("reactive", "half"),
        ("new scenes", "planned"),
        ("reactive", "new scenes"),
        ("static", "planned"),
    )
    for (first, second), level in itertools.product(named, STOP.levels):
        yield Contrast(TASKS[0], level, Side(first, N), Side(second, N))


def report(rows: Path, page: Path) -> None:
    """Write tables and figure of the page."""
    stop, hold = (
        [row for row in read(rows) if row["contact"] == scenes.contact] for scenes in (STOP, HOLD)
    )
    fill_in(page, "primary", table(stop, pairs(LEVELS, TASKS), ()))
    fill_in(
        page,
        "secondary",
        table(stop, (), (("secondary", itertools.chain(pairs((0,), TASKS), others())),)),
    )
    fill_in(page, "hold", table(hold, (), (("secondary", pairs(LEVELS, HELD)),)))
    head = (
        "task",
        "arm",
        "networks",
        *(f"level {level}: SR % (95 %)" for level in STOP.levels),
        "level 1 / 3, each network",
    )
    fill_in(page, "success", markdown(head, list(success(stop))))
    draw(stop, page.with_suffix(".png"))


def success(rows: Sequence[Row]) -> Iterator[list[object]]:
    """A line for each task and arm that has networks: their success at each level, and that of each
    of them."""
    for task, arm in itertools.product(TASKS, (*PAIR, *OTHERS)):
        side, rates = Side(arm, N), {level: Rates(rows, task, level) for level in STOP.levels}
        if seeds := rates[0].seeds(side):
            alone = zip(
                *(100 * rates[level].each(side)[0].mean(1) for level in LEVELS), strict=True
            )
            cells = (
                "{:.0f} ({:.0f}-{:.0f})".format(*percent(rates[level], side))
                for level in STOP.levels
            )
            yield [
                task,
                arm,
                len(seeds),
                *cells,
                ", ".join(f"{one:.0f}/{other:.0f}" for one, other in alone),
            ]


def draw(rows: Sequence[Row], plot: Path) -> None:
    """The primary contrasts that have rows, with their intervals over scenes."""
    figure, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
    found = {
        contrast.task
        for contrast in pairs(LEVELS, TASKS)
        if Rates(rows, contrast.task, contrast.level).seeds(contrast.first)
    }
    tasks = [task for task in TASKS if task in found]
    for (number, level), (place, task) in itertools.product(enumerate(LEVELS), enumerate(tasks)):
        one, other = Rates(rows, task, level).of(Side("reactive", N), Side("planned", N))
        mean, (low, high) = (one - other).mean(), interval({task: one - other})
        where = place + 0.2 * number - 0.1
        bars = [[100 * (mean - low)], [100 * (high - mean)]]
        ax.errorbar(
            [100 * mean],
            [where],
            xerr=bars,
            fmt="o",
            color=f"C{number}",
            capsize=2,
            label="" if place else f"level {level}",
        )
    ax.axvline(0, color="grey", linewidth=0.8)
    ax.set_yticks(range(len(tasks)), tasks)
    ax.invert_yaxis()
    ax.set_xlabel("reactive - planned: success, points (95 %)")
    ax.legend(frameon=False)
    figure.savefig(plot, dpi=120)
    plt.close(figure)


def run(root: Path, rows: Path) -> None:
    """Make the rows that are missing."""
    root.mkdir(parents=True, exist_ok=True)
    study = Study(root, SEED)
    add_missing(rows, units(), lambda unit: tried(study, unit))


if __name__ == "__main__":
    command_line(__doc__, ROWS, run, lambda rows: report(rows, PAGE))

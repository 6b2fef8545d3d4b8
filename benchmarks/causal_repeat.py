"""The repetition of the study of states with new demonstrations, networks and scenes: fourth addendum of preregistration.md.

python -m benchmarks.causal_repeat run DIR [--rows FILE]   makes what is missing, one unit after another; the same command resumes
python -m benchmarks.causal_repeat report [--rows FILE]    tables of docs/science/causal_repeat.md

A row of FILE is one network on the scenes of one level, as in benchmarks/causal.py, and `contact`, what the first touch does.
"""

import argparse
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.causal import Scenes, Study, Unit
from benchmarks.causal_contrasts import LEVELS, Contrast, Side
from benchmarks.causal_tables import Rates, Row, add_missing, fill_in, percent, read, table
from benchmarks.study.rows import markdown

HERE = Path(__file__).parents[1]
ROWS, PAGE = (HERE / "docs" / "science" / f"causal_repeat{suffix}" for suffix in ("_rows.jsonl", ".md"))
TASKS = ("click_bell", "press_stapler", "beat_block_hammer", "grab_roller", "move_can_pot", "place_mouse_pad")
PRESSES, N, SEEDS, SEED = TASKS[:3], 150, 5, 2
STOP, HOLD = Scenes((0, *LEVELS), 100, 1), Scenes(LEVELS, 100, 1, "hold")
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
    for scenes in (STOP, HOLD) if unit.task in PRESSES and unit.arm in PAIR else (STOP,):
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
    """Write the tables of the page."""
    stop, hold = ([row for row in read(rows) if row["contact"] == scenes.contact] for scenes in (STOP, HOLD))
    fill_in(page, "primary", table(stop, pairs(LEVELS, TASKS), ()))
    fill_in(page, "secondary", table(stop, (), (("secondary", itertools.chain(pairs((0,), TASKS), others())),)))
    fill_in(page, "hold", table(hold, (), (("secondary", pairs(LEVELS, PRESSES)),)))
    head = ("task", "arm", "networks", *(f"level {level}: SR % (95 %)" for level in STOP.levels), "level 1 / 3, each network")
    fill_in(page, "success", markdown(head, list(success(stop))))


def success(rows: Sequence[Row]) -> Iterator[list[object]]:
    """A line for each task and arm that has networks: their success at each level, and that of each of them."""
    for task, arm in itertools.product(TASKS, (*PAIR, *OTHERS)):
        side, rates = Side(arm, N), {level: Rates(rows, task, level) for level in STOP.levels}
        if seeds := rates[0].seeds(side):
            alone = zip(*(100 * rates[level].each(side)[0].mean(1) for level in LEVELS), strict=True)
            cells = ("{:.0f} ({:.0f}-{:.0f})".format(*percent(rates[level], side)) for level in STOP.levels)
            yield [task, arm, len(seeds), *cells, ", ".join(f"{one:.0f}/{other:.0f}" for one, other in alone)]


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
        given.root.mkdir(parents=True, exist_ok=True)
        study = Study(given.root, SEED)
        add_missing(given.rows, units(), lambda unit: tried(study, unit))
    else:
        report(given.rows, PAGE)


if __name__ == "__main__":
    main()

"""Tables and curves of docs/science/causal.md from the rows of benchmarks/causal.py."""

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.study.rows import markdown
from pipeline.evaluate.difference import RESAMPLES, interval, sign_flip

TASKS, SIZES, MORE_SIZES, ARMS, SEEDS, LEVELS = (
    ("click_bell", "grab_roller"),
    (50, 150),
    (25, 300),
    ("planned", "reactive", "takeovers"),
    3,
    (1, 3),
)

Row = dict[str, Any]
Side = tuple[str, int]
"""An arm with N episodes a level."""


def read(rows: Path) -> list[Row]:
    """The rows of a file."""
    return [json.loads(line) for line in rows.read_text().splitlines()]


class Rates:
    """Success by scene of the arms in some rows, of one task and level."""

    def __init__(self, rows: Sequence[Row], task: str, level: int) -> None:
        self._rows = [r for r in rows if (r["task"], r["level"]) == (task, level)]

    def seeds(self, *sides: Side) -> list[int]:
        """The seeds that all these have."""
        return sorted(set[int].intersection(*({r["seed"] for r in self._of(side)} for side in sides)))

    def of(self, *sides: Side) -> np.ndarray:
        """Mean success (k,S) of each side and scene over the networks that all have. Scenes that none solved come last."""
        seeds, mine = self.seeds(*sides), [self._of(side) for side in sides]
        scenes, tried = sorted({scene for rows in mine for r in rows for scene in r["solved"]}), mine[0][0]["tried"]
        rates = [np.mean([[scene in r["solved"] for scene in scenes] for r in rows if r["seed"] in seeds], axis=0) for rows in mine]
        return np.pad(rates, ((0, 0), (0, tried - len(scenes))))

    def sizes(self, arm: str) -> list[int]:
        """The N of an arm."""
        return sorted({r["n"] for r in self._rows if r["arm"] == arm})

    def _of(self, side: Side) -> list[Row]:
        return [r for r in self._rows if (r["arm"], r["n"]) == side]


def registered() -> Iterator[tuple[str, int, Side, Side]]:
    """The contrasts of the pre-registration: task, level and both sides."""
    for task, n, level in itertools.product(TASKS, SIZES, LEVELS):
        for first, second in (("reactive", "planned"), ("takeovers", "planned"), ("reactive", "takeovers")):
            yield task, level, (first, n), (second, n)
    for task, level in itertools.product(TASKS, LEVELS):
        yield task, level, ("reactive", min(SIZES)), ("planned", max(SIZES))


def exploratory() -> Iterator[tuple[str, int, Side, Side]]:
    """The contrasts of the addendum."""
    for n, level in itertools.product(SIZES, LEVELS):
        yield TASKS[0], level, ("foresighted", n), ("planned", n)
        yield TASKS[0], level, ("reactive", n), ("foresighted", n)
    for n, level in itertools.product(MORE_SIZES, LEVELS):
        yield TASKS[0], level, ("reactive", n), ("planned", n)


def contrasts(rows: Sequence[Row], wanted: Iterable[tuple[str, int, Side, Side]]) -> list[list[object]]:
    """The lines of `differences`."""
    return [line for line, _ in differences(rows, wanted)]


def differences(rows: Sequence[Row], wanted: Iterable[tuple[str, int, Side, Side]]) -> Iterator[tuple[list[object], float]]:
    """A line for each contrast that has a seed in both arms, and p: the rates, the difference in points with its interval, p."""
    for task, level, *sides in wanted:
        rates = Rates(rows, task, level)
        if not (seeds := rates.seeds(*sides)):
            continue
        one, other = rates.of(*sides)
        low, high = interval({task: one - other})
        p = sign_flip([round(d) for d in (one - other) * len(seeds)])
        effect = f"{100 * np.mean(one - other):+.0f} ({100 * low:+.0f} to {100 * high:+.0f})"
        first, second = (arm if sides[0][1] == sides[1][1] else f"{arm} (N = {n})" for arm, n in sides)
        name = f"{task}, level {level}" + (f", N = {sides[0][1]}" if sides[0][1] == sides[1][1] else "")
        share = [f"{100 * side.mean():.0f} %" for side in (one, other)]
        yield [f"{name}: {first} - {second}", len(seeds), *share, effect, f"{p:.2g}"], p


def shares(rows: Sequence[Row]) -> Iterator[list[object]]:
    """By N and level, the share of the difference between reactive and planned that `foresighted` keeps, with a 95 % interval from
    scenes drawn again."""
    for n, level in itertools.product(SIZES, LEVELS):
        rates, sides = Rates(rows, TASKS[0], level), [(arm, n) for arm in ("planned", "foresighted", "reactive")]
        if seeds := rates.seeds(*sides):
            arms = rates.of(*sides)
            drawn = arms[:, np.random.default_rng(0).integers(arms.shape[1], size=(RESAMPLES, arms.shape[1]))].mean(2)
            share, low, high = (100 * x for x in (_share(arms.mean(1)), *np.quantile(_share(drawn), [0.025, 0.975])))
            yield [f"{TASKS[0]}, level {level}, N = {n}", len(seeds), f"{share:.0f} % ({low:.0f} to {high:.0f})"]


def _share(rates: np.ndarray) -> np.ndarray:
    planned, between, reactive = rates
    return (between - planned) / (reactive - planned)


def report(rows: Path, page: Path, plot: Path) -> None:
    """Write the tables into PAGE.md, between their marks, and the curves into PLOT.png."""
    found = read(rows)
    columns = ("contrast", "networks an arm", "first", "second", "difference (points)", "p")
    fill_in(page, "contrasts", markdown(columns, contrasts(found, registered())))
    fill_in(page, "exploratory", markdown(columns, contrasts(found, exploratory())))
    fill_in(page, "shares", markdown(("scenes", "networks an arm", "share of the difference (95 %)"), list(shares(found))))
    tasks = [task for task in TASKS if any(r["task"] == task for r in found)]
    figure, panels = plt.subplots(
        len(tasks), len(LEVELS), figsize=(8, 2.8 * len(tasks)), sharey=True, squeeze=False, layout="constrained"
    )
    for (task, level), ax in zip(itertools.product(tasks, LEVELS), panels.flat, strict=True):
        rates = Rates(found, task, level)
        for colour, arm in enumerate((*ARMS, "foresighted")):
            if sizes := rates.sizes(arm):
                scenes = [rates.of((arm, n))[0] for n in sizes]
                low, high = np.array([interval({task: s}) for s in scenes]).T
                mean, aside = np.array([s.mean() for s in scenes]), 1.02 ** (colour - 1.5)
                bars = 100 * np.array([mean - low, high - mean])
                ax.errorbar(np.array(sizes) * aside, 100 * mean, bars, fmt="o-", color=f"C{colour}", capsize=2, label=arm)
        ax.set_xscale("log", base=2)
        ticks = sorted({r["n"] for r in found})
        ax.set_xticks(ticks, map(str, ticks))
        ax.set(title=f"{task}, level {level}", xlabel="demonstrations a level", ylim=(0, 100))
        ax.set_xlim(0.8 * ticks[0], 1.25 * ticks[-1])
        ax.minorticks_off()
    for ax in panels[:, 0]:
        ax.set_ylabel("success (%)")
    panels[0, -1].legend(fontsize=7)
    figure.savefig(plot, dpi=120)


def fill_in(page: Path, mark: str, table: str) -> None:
    """Put a table between `<!-- mark -->` and the next `<!-- end -->` of a page."""
    before, begin, rest = page.read_text().partition(f"<!-- {mark} -->\n")
    page.write_text(before + begin + table + "\n" + rest[rest.index("<!-- end -->") :])

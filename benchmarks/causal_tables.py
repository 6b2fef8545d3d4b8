"""Tables and curves of docs/science/causal.md from the rows of benchmarks/causal.py."""

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

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
WIDENED = (
    ("press_stapler", 150, ("planned", "reactive"), "velocity"),
    ("beat_block_hammer", 150, ("planned", "reactive"), "velocity"),
    ("click_bell", 150, ("half", "static"), "velocity"),
    ("grab_roller", 150, ("planned", "reactive"), "velocity"),
    ("click_bell", 150, ("planned", "reactive"), "position"),
    ("click_bell", 150, ("planned", "reactive"), "two_frames"),
    ("place_mouse_pad", 100, ("planned", "reactive"), "velocity"),
    ("click_bell", 300, ("planned", "reactive"), "velocity"),
)
"""The units of the second addendum, in their order: task, N, arms, inputs."""
SHOWN = (*ARMS, "foresighted", "half", "static")

Row = dict[str, Any]


@dataclass(frozen=True)
class Side:
    """An arm with `n` episodes a level, and what its networks see."""

    arm: str
    n: int
    inputs: str = "velocity"


@dataclass(frozen=True)
class Contrast:
    """The difference between two sides on the scenes of a task and level."""

    task: str
    level: int
    first: Side
    second: Side

    def __str__(self) -> str:
        one, other = self._distinguish(self.first, self.second), self._distinguish(self.second, self.first)
        same = [] if self.first.n != self.second.n else [f"N = {self.first.n}"]
        if self.first.arm == self.second.arm:
            same.append(self.first.arm)
        if self.first.inputs == self.second.inputs != "velocity":
            same.append(self.first.inputs)
        return f"{', '.join([self.task, f'level {self.level}', *same])}: {one} - {other}"

    def _distinguish(self, side: Side, other: Side) -> str:
        """What distinguishes a side from the other."""
        if side.arm == other.arm:
            return f"N = {side.n}" if side.n != other.n else side.inputs
        return side.arm if side.n == other.n else f"{side.arm} (N = {side.n})"


def read(rows: Path) -> list[Row]:
    """The rows of a file; the first ones do not name their inputs."""
    return [{"inputs": "velocity"} | json.loads(line) for line in rows.read_text().splitlines()]


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
        return np.pad(np.reshape(rates, (len(sides), -1)), ((0, 0), (0, tried - len(scenes))))

    def sizes(self, arm: str) -> list[int]:
        """The N of an arm whose networks see the velocity."""
        return sorted({r["n"] for r in self._rows if (r["arm"], r["inputs"]) == (arm, "velocity")})

    def _of(self, side: Side) -> list[Row]:
        return [r for r in self._rows if Side(r["arm"], r["n"], r["inputs"]) == side]


def registered() -> Iterator[Contrast]:
    """The contrasts of the pre-registration."""
    for task, n, level in itertools.product(TASKS, SIZES, LEVELS):
        for first, second in (("reactive", "planned"), ("takeovers", "planned"), ("reactive", "takeovers")):
            yield Contrast(task, level, Side(first, n), Side(second, n))
    for task, level in itertools.product(TASKS, LEVELS):
        yield Contrast(task, level, Side("reactive", min(SIZES)), Side("planned", max(SIZES)))


def exploratory() -> Iterator[Contrast]:
    """The contrasts of the first addendum."""
    for n, level in itertools.product(SIZES, LEVELS):
        yield Contrast(TASKS[0], level, Side("foresighted", n), Side("planned", n))
        yield Contrast(TASKS[0], level, Side("reactive", n), Side("foresighted", n))
    for level in LEVELS:
        yield Contrast(TASKS[0], level, Side("reactive", min(MORE_SIZES)), Side("planned", min(MORE_SIZES)))


def primary() -> Iterator[Contrast]:
    """The primary contrasts of the second addendum."""
    for (task, n, _, _), level in itertools.product(WIDENED, LEVELS):
        if task != TASKS[0]:
            yield Contrast(task, level, Side("reactive", n), Side("planned", n))


def secondary() -> Iterator[Contrast]:
    """Its secondary contrasts, on the first task."""
    n, most = max(SIZES), max(MORE_SIZES)
    planned, reactive, half = Side("planned", n), Side("reactive", n), Side("half", n)
    pairs = [(half, planned), (reactive, half), (Side("static", n), planned)]
    for inputs in ("position", "two_frames"):
        pairs += [(Side("reactive", n, inputs), Side("planned", n, inputs)), (reactive, Side("reactive", n, inputs))]
    pairs += [(Side("reactive", most), Side("planned", most)), (Side("reactive", most), reactive), (Side("planned", most), planned)]
    for (first, second), level in itertools.product(pairs, LEVELS):
        yield Contrast(TASKS[0], level, first, second)


def contrasts(rows: Sequence[Row], wanted: Iterable[Contrast]) -> Iterator[tuple[list[object], float]]:
    """Of each contrast with a seed in both arms, a line with the rates and the difference in points with its interval, and p."""
    for contrast in wanted:
        rates, sides = Rates(rows, contrast.task, contrast.level), (contrast.first, contrast.second)
        if not (seeds := rates.seeds(*sides)):
            continue
        one, other = rates.of(*sides)
        low, high = interval({contrast.task: one - other})
        p = sign_flip([round(d) for d in (one - other) * len(seeds)])
        effect = f"{100 * np.mean(one - other):+.0f} ({100 * low:+.0f} to {100 * high:+.0f})"
        yield [contrast, len(seeds), f"{100 * one.mean():.0f} %", f"{100 * other.mean():.0f} %", effect, f"{p:.2g}"], p


def holm(tests: Sequence[float]) -> list[float]:
    """Each p of a family of tests, corrected by Holm's method."""
    order, out, least = np.argsort(tests), [0.0] * len(tests), 0.0
    for rank, i in enumerate(order):
        least = max(least, min(1.0, (len(tests) - rank) * tests[i]))
        out[i] = least
    return out


def shares(rows: Sequence[Row]) -> Iterator[list[object]]:
    """By N and level, the share of the difference between reactive and planned that `foresighted` keeps, with a 95 % interval from
    scenes drawn again."""
    for n, level in itertools.product(SIZES, LEVELS):
        rates, sides = Rates(rows, TASKS[0], level), [Side(arm, n) for arm in ("planned", "foresighted", "reactive")]
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
    for mark, wanted in (("contrasts", registered()), ("exploratory", exploratory())):
        fill_in(page, mark, markdown(columns, [line for line, _ in contrasts(found, wanted)]))
    tested, others = list(contrasts(found, primary())), list(contrasts(found, secondary()))
    corrected = [*(f"{p:.2g}" for p in holm([p for _, p in tested])), *("secondary" for _ in others)]
    lines = [[*line, p] for (line, _), p in zip([*tested, *others], corrected, strict=True)]
    fill_in(page, "widened", markdown((*columns, "p (Holm)"), lines))
    fill_in(page, "shares", markdown(("scenes", "networks an arm", "share of the difference (95 %)"), list(shares(found))))
    draw(found, plot)


def draw(rows: Sequence[Row], plot: Path) -> None:
    """Success against demonstrations of networks that see the velocity: a column for each task, a row for each level."""
    tasks = list(dict.fromkeys(r["task"] for r in rows))
    sizes = {task: sorted({r["n"] for r in rows if (r["task"], r["inputs"]) == (task, "velocity")}) for task in tasks}
    tasks.sort(key=lambda task: -len(sizes[task]))
    figure, panels = plt.subplots(
        len(LEVELS),
        len(tasks),
        figsize=(11, 5.2),
        sharey=True,
        squeeze=False,
        layout="constrained",
        gridspec_kw={"width_ratios": [1 + len(sizes[task]) for task in tasks]},
    )
    for (row, level), (column, task) in itertools.product(enumerate(LEVELS), enumerate(tasks)):
        ax = panels[row, column]
        curves(ax, Rates(rows, task, level), sizes[task])
        ax.set_title(task if row == 0 else "", fontsize=10)
        ax.set_xlabel("demonstrations a level" if row else "")
        ax.set_ylabel(f"level {level}: success (%)" if column == 0 else "")
    handles = {label: handle for ax in panels.flat for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    names = [arm for arm in SHOWN if arm in handles]
    figure.legend([handles[arm] for arm in names], names, loc="outside upper center", ncols=len(names), frameon=False)
    figure.savefig(plot, dpi=120)


def curves(ax: Axes, rates: Rates, sizes: Sequence[int]) -> None:
    """The rates of one task and level, with 95 % intervals over scenes."""
    arms = [arm for arm in SHOWN if rates.sizes(arm)]
    for arm in arms:
        mine = rates.sizes(arm)
        scenes = [rates.of(Side(arm, n))[0] for n in mine]
        low, high = np.array([interval({"": s}) for s in scenes]).T
        mean = np.array([s.mean() for s in scenes])
        aside = 0.12 * (arms.index(arm) - (len(arms) - 1) / 2)
        bars, colour = 100 * np.array([mean - low, high - mean]), f"C{SHOWN.index(arm)}"
        ax.errorbar([sizes.index(n) + aside for n in mine], 100 * mean, bars, fmt="o-", color=colour, capsize=2, label=arm)
    ax.set_xticks(range(len(sizes)), map(str, sizes))
    ax.set(xlim=(-0.5, len(sizes) - 0.5), ylim=(0, 100))
    ax.grid(axis="y", alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)


def fill_in(page: Path, mark: str, table: str) -> None:
    """Put a table between `<!-- mark -->` and the next `<!-- end -->` of a page."""
    before, begin, rest = page.read_text().partition(f"<!-- {mark} -->\n")
    page.write_text(before + begin + table + "\n" + rest[rest.index("<!-- end -->") :])

"""Tables and figure of docs/science/phases.md from the rows of benchmarks/phase_diagram.py."""

import itertools
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t as student

from benchmarks.causal_tables import fill_in
from benchmarks.study.rows import markdown
from pipeline.data.clock import DEFAULT_FPS
from pipeline.evaluate.scoring.statistics import holm
from pipeline.poses import Floats

PAGE = Path(__file__).parents[1] / "docs" / "science" / "phases.md"

Row = dict[str, Any]
Cell = tuple[int, int, float]
"""Actions executed of a chunk, latency (ms), and alpha (m/s)."""


@dataclass(frozen=True)
class CrossedMean:
    """A mean, its 95 % interval, and the p of a mean of 0."""

    mean: float
    low: float
    high: float
    p: float

    def __str__(self) -> str:
        return f"{self.mean:+.1f} ({self.low:+.0f} to {self.high:+.0f})"


def crossed(values: ArrayLike) -> CrossedMean:
    """The mean of values (A,B,S): of S scenes, tried by B networks of each of A sets of
    demonstrations.

    Sets, networks within sets and scenes are drawn from all there might be: the mixed model whose
    variances are those of the mean squares (Searle, Casella & McCulloch, Variance Components,
    1992, chapter 4), with Satterthwaite's degrees of freedom. Raises ValueError for one set or one
    scene, which show no spread.
    """
    y = np.asarray(values, float)
    a, b, s = y.shape
    if a < 2 or s < 2:
        raise ValueError("one set of demonstrations, or one scene, shows no spread")
    mean, sets, scenes = y.mean(), y.mean((1, 2)), y.mean((0, 1))
    both = y.mean(1) - sets[:, None] - scenes + mean
    squares = np.array(
        [
            b * s * ((sets - mean) ** 2).sum() / (a - 1),
            a * b * ((scenes - mean) ** 2).sum() / (s - 1),
            b * (both**2).sum() / ((a - 1) * (s - 1)),
        ]
    )
    freedom = np.array([a - 1, s - 1, (a - 1) * (s - 1)])
    # the third is in both others; of a chance excess of it, no negative variance is made
    total = max(squares[0] + squares[1] - squares[2], squares[:2].max())
    if total <= 0:
        return CrossedMean(float(mean), float(mean), float(mean), float(mean == 0))
    signs = squares * (1, 1, -1)
    df = max(1.0, total**2 / (signs**2 / freedom).sum())
    error = float(np.sqrt(total / y.size))
    half = student.ppf(0.975, df) * error
    p = 2 * student.sf(abs(mean) / error, df)
    return CrossedMean(float(mean), float(mean - half), float(mean + half), float(p))


class Cube:
    """Success of one task, in per cent: (A,B,S) of an arm, inputs and a cell, of the sets and
    networks that all arms have."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._solved = {
            (r["arm"], r["inputs"], r["set"], r["network"]): {
                self._cell(name): [int(won) for won in text] for name, text in r["solved"].items()
            }
            for r in rows
        }
        cells = {cell for solved in self._solved.values() for cell in solved}
        self.executed = sorted({execute for execute, _, _ in cells})
        self.latencies = sorted({latency for _, latency, _ in cells})
        self.alphas = sorted({alpha for *_, alpha in cells})
        self.arms = sorted({arm for arm, *_ in self._solved})
        self.inputs = sorted({inputs for _, inputs, _, _ in self._solved})
        # networks come one by one: sets that have the first one, then networks that these have
        sets = sorted({held for _, _, held, _ in self._solved})
        networks = sorted({network for *_, network in self._solved})
        self.sets = [held for held in sets if self._has(held, networks[0])]
        self.networks = [n for n in networks if all(self._has(held, n) for held in self.sets)]

    def _has(self, held: int, network: int) -> bool:
        arms = itertools.product(self.arms, self.inputs)
        return all((*arm, held, network) in self._solved for arm in arms)

    @staticmethod
    def _cell(name: str) -> Cell:
        execute, latency, alpha = name.split()
        return int(execute), int(latency), float(alpha)

    def of(self, arm: str, inputs: str, cell: Cell) -> Floats:
        """(A,B,S), in the order of scenes."""
        return 100 * np.array(
            [
                [self._solved[arm, inputs, held, network][cell] for network in self.networks]
                for held in self.sets
            ],
            float,
        )

    def mean(self, arm: str, inputs: str, takes: Callable[[Cell], bool]) -> Floats:
        """(A,B,S), the mean over the cells that are taken; scenes of speeds are matched by their
        place in the list."""
        return np.mean([self.of(arm, inputs, cell) for cell in self.cells() if takes(cell)], axis=0)

    def history(self, arm: str, takes: Callable[[Cell], bool]) -> Floats:
        """What seeing two frames in place of one adds, as `mean`."""
        return self.mean(arm, "two_frames", takes) - self.mean(arm, "position", takes)

    def cells(self) -> Iterator[Cell]:
        """All cells."""
        return itertools.product(self.executed, self.latencies, self.alphas)


Contrasts = Mapping[str, Callable[[Cube], Floats]]

PRIMARY: Contrasts = {
    "history, reactive, all cells": lambda c: c.history("reactive", lambda _: True),
    "history, planned, all cells": lambda c: c.history("planned", lambda _: True),
    "history at 0.2 minus at 0.05 m/s, reactive": lambda c: (
        c.history("reactive", lambda cell: cell[2] == 0.2)
        - c.history("reactive", lambda cell: cell[2] == 0.05)
    ),
    "history at 8 minus at 1 action executed, reactive": lambda c: (
        c.history("reactive", lambda cell: cell[0] == 8)
        - c.history("reactive", lambda cell: cell[0] == 1)
    ),
    "history at 300 minus at 0 ms, reactive": lambda c: (
        c.history("reactive", lambda cell: cell[1] == 300)
        - c.history("reactive", lambda cell: cell[1] == 0)
    ),
    "reactive minus planned, history, all cells": lambda c: (
        c.mean("reactive", "two_frames", lambda _: True)
        - c.mean("planned", "two_frames", lambda _: True)
    ),
}
"""The contrasts of the pre-registration, of a task."""


def by_task(rows: Sequence[Row]) -> dict[str, Cube]:
    """The tasks that have a network of all arms in two sets or more."""
    tasks = dict.fromkeys(row["task"] for row in rows)
    cubes = {task: Cube([row for row in rows if row["task"] == task]) for task in tasks}
    return {task: cube for task, cube in cubes.items() if len(cube.sets) > 1}


def contrasts(cubes: Mapping[str, Cube]) -> str:
    """The primary contrasts, corrected by Holm's method over those of each task."""
    lines = list[list[object]]()
    for task, cube in cubes.items():
        found = {name: crossed(contrast(cube)) for name, contrast in PRIMARY.items()}
        corrected = holm([estimate.p for estimate in found.values()])
        size = f"{len(cube.sets)} x {len(cube.networks)}"
        for (name, estimate), p in zip(found.items(), corrected, strict=True):
            lines.append([task, name, size, estimate, f"{estimate.p:.2g}", f"{p:.2g}"])
    head = ("task", "contrast", "sets x networks", "points (95 %)", "p", "p (Holm)")
    return markdown(head, lines)


def success(cubes: Mapping[str, Cube]) -> str:
    """Success of every cell, without and with history, by arm."""
    lines = list[list[object]]()
    for task, cube in cubes.items():
        for arm, cell in itertools.product(cube.arms, cube.cells()):
            one, two = (cube.of(arm, inputs, cell) for inputs in ("position", "two_frames"))
            where = (f"{cell[0] / DEFAULT_FPS:.2f}", cell[1], f"{cell[2]:g}")
            lines.append([task, arm, *where, f"{one.mean():.0f}", f"{two.mean():.0f}"])
            lines[-1].append(crossed(two - one))
    head = ("task", "demonstrations", "interval (s)", "latency (ms)", "alpha (m/s)")
    return markdown((*head, "one frame, %", "two frames, %", "difference, points (95 %)"), lines)


def draw(cubes: Mapping[str, Cube], plot: Path) -> None:
    """Success by interval and latency: a row for each task, demonstrations and input, a column for
    each speed."""
    kinds = [
        (task, cube, arm, inputs)
        for task, cube in cubes.items()
        for arm, inputs in itertools.product(cube.arms, cube.inputs)
    ]
    columns = len(kinds[0][1].alphas)
    size = (2.3 * columns + 1, 1.7 * len(kinds))
    figure, axes = plt.subplots(
        len(kinds), columns, sharex=True, sharey=True, squeeze=False, figsize=size
    )
    figure.set_layout_engine("constrained")
    seen = {"position": "one frame", "two_frames": "two frames"}
    for line, (task, cube, arm, inputs) in zip(axes, kinds, strict=True):
        for axis, alpha in zip(line, cube.alphas, strict=True):
            cells = itertools.product(cube.latencies, cube.executed)
            rates = [cube.of(arm, inputs, (execute, ms, alpha)).mean() for ms, execute in cells]
            rate = np.reshape(rates, (len(cube.latencies), len(cube.executed)))
            axis.imshow(rate, vmin=0, vmax=100, cmap="viridis", origin="lower")
            for (y, x), value in np.ndenumerate(rate):
                colour = "white" if value < 60 else "black"
                axis.text(x, y, f"{value:.0f}", ha="center", va="center", color=colour, fontsize=8)
            axis.set_xticks(
                range(len(cube.executed)), [f"{e / DEFAULT_FPS:.2f}" for e in cube.executed]
            )
            axis.set_yticks(range(len(cube.latencies)), list(map(str, cube.latencies)))
            axis.set_title(f"{alpha:g} m/s" if axis in axes[0] else "", fontsize=9)
        line[0].set_ylabel(f"{task}\n{arm}\n{seen[inputs]}\nlatency (ms)", fontsize=7)
    for axis in axes[-1]:
        axis.set_xlabel("replanning interval (s)", fontsize=8)
    figure.colorbar(axes[0, 0].images[0], ax=axes, label="success (%)", shrink=0.5)
    figure.savefig(plot, dpi=110)
    plt.close(figure)


def report(rows: Path) -> None:
    """Write tables and figure of the page. Exits in one line if there are too few rows."""
    text = rows.read_text() if rows.exists() else ""
    cubes = by_task([json.loads(line) for line in text.splitlines()])
    if not cubes:
        sys.exit(f"{rows}: two sets of demonstrations with a network of each arm are needed")
    fill_in(PAGE, "contrasts", contrasts(cubes))
    fill_in(PAGE, "success", success(cubes))
    draw(cubes, PAGE.with_suffix(".png"))

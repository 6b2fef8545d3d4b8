"""The study as pictures."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from benchmarks.study.plan import ALPHAS, CHUNKS, LATE, LATENCY, POLICIES, late
from benchmarks.study.rows import Rate, StudyRows, at
from benchmarks.study.tables import answers


def policies(rows: StudyRows, path: Path) -> None:
    """Success rate against alpha at levels 1 and 3, a line per policy."""
    rows = rows.of(clock="sim", rules="strict")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", sharey=True)
    alphas = (0.0, *ALPHAS)
    for axis, level in zip(axes, (1, 3), strict=True):
        for policy in POLICIES[:4]:
            _line(axis, alphas, [at(rows.of(policy=policy), level, a).rate for a in alphas], policy)
        axis.set(title=f"level {level}", xlabel="alpha (m/s)", ylim=(-3, 103))
    axes[0].set(ylabel="success rate (%)")
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def timing(rows: StudyRows, path: Path) -> None:
    """Success rate of recorded actions against the target's delay: tasks thin, at all alphas
    together; all tasks thick, an alpha a line; both contact rules."""
    rows = rows.of(policy="replay", level=1)
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained", sharey=True)
    seconds = [ms / 1000 for ms in LATE]
    for axis, (rules, title) in zip(
        axes, (("strict", "stop"), ("strict-continue", "continue")), strict=True
    ):
        group = rows.of(rules=rules)
        for task in group.values("task"):
            rates = [group.of(task=task, clock=late(ms)).rate.percent for ms in LATE]
            axis.plot(seconds, rates, lw=0.9, alpha=0.8, marker=".", label=task)
        for a, style in (
            (a, style)
            for a, style in zip(ALPHAS, (":", "-", "--"), strict=True)
            if a in group.values("alpha")
        ):
            rates = [group.of(alpha=a, clock=late(ms)).rate.percent for ms in LATE]
            axis.plot(seconds, rates, f"k{style}", lw=2, label=f"all, alpha {a:g}")
        axis.set(title=f"contact: {title}", xlabel="target late by (s)", ylim=(-3, 103))
        axis.legend(fontsize=6)
    axes[0].set(ylabel="success rate (%)")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def delays(rows: StudyRows, path: Path) -> None:
    """Success rate of the interceptor against latency, level 1."""
    rows = rows.of(rules="strict", level=1, alpha=0.1)
    figure, axis = plt.subplots(figsize=(5, 3.4), layout="constrained")
    for chunk in CHUNKS:
        _line(
            axis,
            LATENCY,
            [answers(rows, chunk, ms).rate for ms in LATENCY],
            f"{chunk} action{'s' * (chunk > 1)} an answer",
        )
    axis.set(xlabel="latency of every answer (ms)", ylabel="success rate (%)", ylim=(-3, 103))
    axis.legend(fontsize=8)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _line(axis: Axes, x: Sequence[float], rates: Sequence[Rate], label: str) -> None:
    middle = np.array([r.percent for r in rates])
    low, high = np.array([r.interval for r in rates]).T
    axis.errorbar(
        x,
        middle,
        yerr=[np.maximum(middle - low, 0), np.maximum(high - middle, 0)],
        marker="o",
        capsize=3,
        label=label,
    )

"""Comparison of two policies on the same scenes. Every task counts the same."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm

from pipeline.poses import Floats

RESAMPLES = 4000

ByTask = Mapping[str, Floats]
"""A number (N,) of each scene, by task."""


@dataclass(frozen=True)
class SceneResult:
    """Success of both on a scene, means over episodes, and episodes that the second won and
    lost."""

    task: str
    first: float
    second: float
    won: int
    lost: int


def by_task(pairs: Sequence[tuple[str, float]]) -> ByTask:
    out = defaultdict[str, list[float]](list)
    for task, value in sorted(pairs):
        out[task].append(value)
    return {task: np.array(values) for task, values in out.items()}


def paired_numbers(scenes: Sequence[SceneResult], effect: float) -> dict[str, Any]:
    """Rates (per cent), effect (points) with its 95 % interval, p, and the scenes needed for
    `effect`."""
    change = by_task([(s.task, s.second - s.first) for s in scenes])
    low, high = interval(change)
    first, second = (
        100 * mean(by_task([(s.task, getattr(s, which)) for s in scenes]))
        for which in ("first", "second")
    )
    return {
        "first_rate": first,
        "second_rate": second,
        "effect": second - first,
        "interval": [100 * low, 100 * high],
        "won": sum(s.won for s in scenes),
        "lost": sum(s.lost for s in scenes),
        "p": sign_flip([s.won - s.lost for s in scenes]),
        "needed": scenes_needed(spread(change), effect / 100),
    }


def mean(values: ByTask) -> float:
    """The mean of the means of the tasks."""
    return float(np.mean([v.mean() for v in values.values()]))


def spread(values: ByTask) -> float:
    """Variance of scenes within tasks, a mean over tasks that have two, or 0."""
    return float(np.mean([v.var(ddof=1) for v in values.values() if len(v) > 1] or [0.0]))


def interval(change: ByTask) -> tuple[float, float]:
    """Bootstrap the 95 % interval of the mean over scenes in tasks; exact if all changed alike. A
    task of one scene, or any if no task varies, adds its exact interval (Zou & Donner 2008)."""
    values = np.concatenate(list(change.values()))
    if np.ptp(values) == 0:
        return _exact(float(values[0]), len(values))
    rng = np.random.default_rng(0)
    sizes = ((v, (RESAMPLES, len(v))) for v in change.values())
    means = np.mean([v[rng.integers(len(v), size=size)].mean(1) for v, size in sizes], axis=0)
    ends = np.quantile(means, [0.025, 0.975])
    none_varies = all(np.ptp(v) == 0 for v in change.values())
    few = [v for v in change.values() if len(v) == 1 or none_varies]
    if few:
        exact = np.array([np.subtract(_exact(float(v[0]), len(v)), v[0]) for v in few])
        margins = np.vstack([ends - mean(change), exact / len(change)])
        ends = mean(change) + np.array([-1, 1]) * np.linalg.norm(margins, axis=0)
    low, high = np.clip(ends, -1, 1)
    return float(low), float(high)


def _exact(change: float, scenes: int) -> tuple[float, float]:
    """The same on all scenes: another change is rarer than 1 - 0.025^(1/scenes)."""
    room = (1 - 0.025 ** (1 / scenes)) * (1 + abs(change))
    return max(-1.0, change - room), min(1.0, change + room)


def sign_flip(differences: Sequence[int]) -> float:
    """Two-sided exact p that the differences (won - lost) with random signs add up to as much.
    McNemar's test for one episode a scene."""
    chances = np.ones(1)
    for size in (abs(d) for d in differences if d):
        step = np.zeros(2 * size + 1)
        step[[0, -1]] = 0.5
        chances = np.convolve(chances, step)
    sums = np.arange(len(chances)) - len(chances) // 2
    return float(min(1.0, chances[np.abs(sums) >= abs(sum(differences))].sum()))


def scenes_needed(variance: float, effect: float) -> int | None:
    """Scenes that detect a difference of `effect` (0-1) at the 5 % level: (z + z)^2 variance /
    effect^2. None for a variance of 0."""
    if not variance:
        return None
    return ceil((norm.ppf(0.975) + norm.ppf(0.8)) ** 2 * variance / effect**2)


Z95 = 1.959963984540054


def wilson(successes: float, n: float) -> tuple[float, float]:
    """Wilson's score interval, in 0-1; (0, 1) without trials. Wilson (1927), JASA 22:209-212."""
    if n == 0:
        return 0.0, 1.0
    p, z = successes / n, Z95
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


def bootstrap(*groups: Sequence[float]) -> tuple[float, float]:
    """95 % percentile interval of the mean of the groups' means, of values in any order that are
    drawn inside their group; NaN for none."""
    if not all(map(len, groups)):
        return float("nan"), float("nan")
    rng, means = np.random.default_rng(0), np.zeros(2000)
    for group in groups:
        values = np.sort(np.asarray(group, float))
        means += values[rng.integers(len(values), size=(len(means), len(values)))].mean(1)
    low, high = np.quantile(means / len(groups), [0.025, 0.975])
    return float(low), float(high)


def clustered(clusters: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """Wilson's interval, in 0-1, of a rate from (successes, trials) by cluster. They count as p
    (1 - p) / v trials, v the variance of p between clusters. Dean & Pagano (2015), J. Surv.
    Stat. Methodol. 3:484-503."""
    if not clusters:
        return wilson(0, 0)
    solved, trials = np.array(clusters, float).T
    count, total, rate = len(clusters), trials.sum(), solved.sum() / trials.sum()
    variance = count / max(1, count - 1) * float(((solved - rate * trials) ** 2).sum()) / total**2
    apart = rate * (1 - rate)
    effective = total if apart else count
    if variance:
        effective = float(np.clip(apart / variance, count, total))
    return wilson(rate * effective, effective)


BETS = np.linspace(0.3, 0.95, 8)
"""Shares of the wealth that are staked, on either policy."""


@dataclass(frozen=True)
class SequentialTest:
    """`p` is valid after any scene, `better` is the sign of the difference, and about `more` scenes
    would decide."""

    scenes: int
    decided: int | None
    p: float
    better: int
    more: int | None


def wealth(differences: Sequence[float]) -> Floats:
    """Log wealth (N, 2) after each of N differences in [-1, 1], of bets on each sign. Raises
    ValueError."""
    x = np.asarray(differences, float)
    if x.size and not np.abs(x).max() <= 1:
        raise ValueError("differences lie in [-1, 1]")
    sides = [np.log1p(np.outer(x, sign * BETS)).cumsum(0) for sign in (1, -1)]
    return np.stack([logsumexp(side, axis=1) for side in sides], 1) - np.log(2 * len(BETS))


def sequential(differences: Sequence[float], alpha: float = 0.05) -> SequentialTest:
    """The test of differences in [-1, 1], second policy minus first, in the order of the scenes."""
    sides = wealth(differences)
    total = logsumexp(sides, axis=1)
    highest = float(total.max(initial=0.0))
    over = np.flatnonzero(total >= -np.log(alpha))
    if over.size:
        at = int(over[0])
        better = 1 if sides[at, 0] > sides[at, 1] else -1
        return SequentialTest(len(total), at + 1, float(np.exp(-highest)), better, 0)
    pace = float(total[-1]) / len(total) if len(total) else 0.0
    more = ceil((-np.log(alpha) - total[-1]) / pace) if pace > 0 else None
    return SequentialTest(len(total), None, float(np.exp(-highest)), 0, more)


def holm(p: Sequence[float]) -> list[float]:
    """Adjusted p, in their order. Holm (1979), Scand. J. Stat. 6:65-70."""
    order = np.argsort(p, kind="stable")
    steps = np.asarray(p)[order] * np.arange(len(p), 0, -1)
    out = np.empty(len(p))
    out[order] = np.minimum(1, np.maximum.accumulate(steps))
    return out.tolist()

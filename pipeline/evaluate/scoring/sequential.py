"""Which of two policies is better, after as few scenes as possible, by betting against "no
difference". The chance that the wealth ever reaches 1 / alpha is at most alpha (Ville).
Waudby-Smith & Ramdas (2024), JRSS B 86:1-27; arXiv:2603.13616; for a limit of scenes
arXiv:2503.10966."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

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


def wealth(differences: Sequence[float]) -> NDArray[np.float64]:
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

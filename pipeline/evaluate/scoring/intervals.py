"""Intervals of a success rate and of a mean."""

from collections.abc import Sequence

import numpy as np

Z95 = 1.959963984540054


def wilson(successes: float, trials: float, z: float = Z95) -> tuple[float, float]:
    """Wilson's score interval of a proportion, in 0-1; (0, 1) without trials. Wilson (1927), JASA
    22:209-212."""
    if trials == 0:
        return 0.0, 1.0
    p, n = successes / trials, trials
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


def bootstrap(
    values: Sequence[float], level: float = 0.95, resamples: int = 2000
) -> tuple[float, float]:
    """Percentile interval of the mean over resamples with replacement, the same for the same values
    in any order; NaN for none."""
    if not len(values):
        return float("nan"), float("nan")
    ordered = np.sort(np.asarray(values, float))
    index = np.random.default_rng(0).integers(len(ordered), size=(resamples, len(ordered)))
    low, high = np.quantile(ordered[index].mean(1), [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def clustered(clusters: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """Wilson's interval, in 0-1, of a rate whose trials come in clusters: (successes, trials) of
    each, such as of a scene that several networks tried.

    The trials count as p (1 - p) / v independent ones, v the variance of the rate p between
    clusters, but as no more than there are trials and no fewer than there are clusters. Dean &
    Pagano (2015), J. Surv. Stat. Methodol. 3:484-503.
    """
    if not clusters:
        return wilson(0, 0)
    solved, trials = np.array(clusters, float).T
    count, total, rate = len(clusters), trials.sum(), solved.sum() / trials.sum()
    variance = count / max(1, count - 1) * float(((solved - rate * trials) ** 2).sum()) / total**2
    apart = rate * (1 - rate)
    effective = (
        float(np.clip(apart / variance, count, total)) if variance else (total if apart else count)
    )
    return wilson(rate * effective, effective)

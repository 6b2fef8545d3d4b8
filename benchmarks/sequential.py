"""Rollouts that a sequential comparison saves against 50 scenes and McNemar's exact test.

    python -m benchmarks.sequential [--runs 2000] [--limit 65]

Two simulated policies of known success rates try the same scenes. What a policy does not solve gets
a score between 0 and 1, higher for the better policy. The sequential test looks after every scene
and gives up at the limit. `fixed` and `found` are the shares of the runs in which the fixed and the
sequential test see a difference; `scenes` is the mean number that the sequential one needs. The row
without a difference shows the false alarms.
"""

import argparse

import numpy as np
from scipy.stats import binom

from pipeline.evaluate.scoring.statistics import sequential

PAIRS = (
    (0.5, 0.5),
    (0.5, 0.6),
    (0.6, 0.8),
    (0.2, 0.5),
    (0.4, 0.7),
    (0.2, 0.55),
    (0.3, 0.7),
    (0.1, 0.6),
    (0.2, 0.8),
)
FIXED = 50


def rollouts(rng: np.random.Generator, shape: tuple[int, int], rate: float) -> np.ndarray:
    """Scores of a policy: 1 where it solves a scene, else what it did of the way."""
    return np.where(rng.random(shape) < rate, 1, rng.beta(1 + 3 * rate, 2, shape))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--limit", type=int, default=65)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    print("| success rates, % | fixed, % | score | found, % | scenes | saved, % |")
    print("|---|---:|---|---:|---:|---:|")
    for first, second in PAIRS:
        shape = options.runs, options.limit
        one, two = rollouts(rng, shape, first), rollouts(rng, shape, second)
        solved = (two == 1).astype(float) - (one == 1)
        won, lost = (solved[:, :FIXED] > 0).sum(1), (solved[:, :FIXED] < 0).sum(1)
        fixed = 2 * binom.cdf(np.minimum(won, lost), won + lost, 0.5) <= 0.05
        for name, differences in (("success", solved), ("partial credit", two - one)):
            at = [sequential(row).decided for row in differences]
            found = np.mean([n is not None for n in at])
            scenes = np.mean([n or options.limit for n in at])
            print(
                f"| {100 * first:.0f}, {100 * second:.0f} | {100 * fixed.mean():.1f} | {name} |"
                f" {100 * found:.1f} | {scenes:.1f} | {100 * (1 - scenes / FIXED):.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()

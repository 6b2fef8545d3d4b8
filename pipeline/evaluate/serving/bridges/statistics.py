"""From normalised actions to joint targets by a statistics file, which StarVLA's servers of before PR #318 leave to the client."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.parsing import ParseError, read_json
from pipeline.evaluate.lines import line_of_text
from pipeline.evaluate.policies.policy import PolicyError
from pipeline.poses import Floats

BOUNDS = {"min_max": ("min", "max"), "q99": ("q01", "q99")}
"""Names of the bounds in a statistics file that -1 and 1 stand for, by normalization."""


@dataclass(frozen=True, eq=False)
class Statistics:
    """Bounds (A,) of every number of an action, in the server's order, and which numbers (A,) are normalised at all."""

    low: Floats
    high: Floats
    normalized: NDArray[np.bool_]

    def joints(self, actions: NDArray[Any]) -> Floats:
        """Joint targets (T,A) of normalised actions (T,A), which are clipped to [-1, 1]."""
        values = np.clip(np.asarray(actions, float), -1, 1)
        return np.where(self.normalized, self.low + (values + 1) / 2 * (self.high - self.low), values)


def read_statistics(path: Path, key: str | None, kind: str) -> Statistics:
    """The action statistics of a dataset_statistics.json: those of `key`, or the only ones there are. Raises PolicyError."""
    if kind not in BOUNDS:
        raise PolicyError(f"normalization={line_of_text(kind)} is unknown: choose {', '.join(BOUNDS)}")
    try:
        found = read_json(path)
        keys = list(found)
        chosen = key or (keys[0] if len(keys) == 1 else None)
        if chosen not in keys:
            raise PolicyError(f"{path}: has statistics of {line_of_text(', '.join(keys))}: give one as ?unnorm_key=")
        action = found[chosen]["action"]
        low, high = (np.asarray(action[name], float) for name in BOUNDS[kind])
        normalized = np.asarray(action.get("mask", np.ones(low.shape, bool)), bool)
    except (ParseError, TypeError, KeyError, ValueError, AttributeError) as error:
        raise PolicyError(f"{path}: is no dataset_statistics.json of StarVLA: {line_of_text(error)}") from error
    if low.ndim != 1 or not low.shape == high.shape == normalized.shape or not np.isfinite([low, high]).all():
        raise PolicyError(f"{path}: the bounds of {chosen} are no lists of as many numbers")
    return Statistics(low, high, normalized)

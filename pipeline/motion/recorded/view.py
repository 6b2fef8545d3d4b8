"""How well a camera sees the target just before it is met: the share of its silhouette that is in
the image and not occluded."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.state_log import StateLog

SECONDS = 0.5
"""s before the first touch that are looked at."""

LEAST = 0.25
"""Share of the target's silhouette from which on it counts as seen."""


def before_meeting(log: StateLog, shares: NDArray[Any]) -> NDArray[Any]:
    """Rows of `shares` (T,) in the last half second until the first touch of the target, of the
    whole log without one."""
    met = log.time_of("meeting")
    end = float(log.times[-1]) if met is None else met
    return shares[(log.times > end - SECONDS + 1e-9) & (log.times <= end + 1e-9)]


def is_hidden(last: NDArray[Any]) -> bool:
    """Whether a target is seen in none of the frames before the meeting, of which `last` (F,) are
    the shares."""
    return bool((last < LEAST).all())


def is_unoccluded(last: NDArray[Any]) -> bool:
    """Whether a target is seen in at least half of the frames (F,) before the meeting: `view:
    unoccluded`."""
    return bool(np.mean(last >= LEAST) >= 0.5)

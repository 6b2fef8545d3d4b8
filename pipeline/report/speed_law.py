"""Drawn against accepted: the motion of the first attempt at a slot that had one, and that of
its episode. They differ where an attempt with a fast target failed and a later one drew another
motion."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

SHORT = 0.05
"""m; a target that moved less is hardly seen to move."""

type Row = Mapping[str, Any]


@dataclass(frozen=True)
class Law:
    """Means over a number of motions: average and end speed (m/s), displacement (m), and shares by
    displacement and speed.

    `short` is the share that moved less than 5 cm, `slow` the share with an average speed of at
    most 0.01 m/s, `fast` the share with one of at least 0.8 alpha."""

    count: int
    average_speed: float
    end_speed: float
    displacement: float
    short: float
    slow: float
    fast: float


def law(rows: Sequence[Row]) -> Law | None:
    """The means of a group of attempts (columns of data.records.ATTEMPTS); None for no attempts."""
    if not rows:
        return None
    speed, end, moved, alpha = (
        np.array([float(r[k]) for r in rows])
        for k in ("average_speed", "end_speed", "displacement", "alpha")
    )
    shares = [
        float(np.mean(x))
        for x in (moved < SHORT, speed <= 0.01 + 1e-9, speed >= 0.8 * alpha - 1e-9)
    ]
    return Law(len(rows), float(speed.mean()), float(end.mean()), float(moved.mean()), *shares)


def drawn_and_accepted(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """Of attempts in any order: the first with a motion of every slot, and those accepted; still
    targets are left out."""
    slots: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in rows:
        if row.get("average_speed"):
            slots[
                tuple(row[k] for k in ("task", "embodiment", "level", "alpha", "domain", "slot"))
            ].append(row)
    tried = [sorted(of_slot, key=lambda r: r["attempt"]) for of_slot in slots.values()]
    return [one[0] for one in tried], [
        r for one in tried for r in one if r["outcome"] == "accepted"
    ]

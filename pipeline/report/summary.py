"""The numbers of a report."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from pipeline.data.recipe.model import Cell
from pipeline.data.slots.records import ATTEMPTS

SHORT = 0.05
"""m; a target that moved less is hardly seen to move."""

MOTION = ("average_speed", "end_speed", "displacement", "alpha")
"""What `law` reads of an attempt."""

PLACE = Cell.__match_args__

type Row = Mapping[str, Any]


class EpisodeFacts(NamedTuple):
    """One episode: its length in s, and the average and maximum speed of its target in m/s."""

    path: Path
    seconds: float
    average_speed: float
    maximum_speed: float


@dataclass(frozen=True)
class Group:
    """A cell, its accepted episodes, and its attempts (columns ATTEMPTS)."""

    cell: Cell
    episodes: Sequence[EpisodeFacts] = ()
    attempts: pa.Table = field(default_factory=ATTEMPTS.empty_table)


@dataclass(frozen=True)
class Law:
    """Means over motions: speeds (m/s), displacement (m), and shares: `short` moved less than
    SHORT, `slow` at most 0.01 m/s, `fast` at least 0.8 alpha.
    """

    count: int
    average_speed: float
    end_speed: float
    displacement: float
    short: float
    slow: float
    fast: float


def law(rows: Sequence[Row]) -> Law | None:
    """Means of attempts (columns ATTEMPTS); None for none."""
    if not rows:
        return None
    speed, end, moved, alpha = (np.array([float(r[k]) for r in rows]) for k in MOTION)
    shares = (moved < SHORT, speed <= 0.01 + 1e-9, speed >= 0.8 * alpha - 1e-9)
    return Law(len(rows), *(float(np.mean(values)) for values in (speed, end, moved, *shares)))


def drawn_and_accepted(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """The first motion of every slot, and those accepted; they differ if a later attempt drew
    another. Still targets are left out.
    """
    slots: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in rows:
        if row.get("average_speed"):
            slots[tuple(row[k] for k in (*PLACE, "slot"))].append(row)
    tried = [sorted(of_slot, key=lambda r: r["attempt"]) for of_slot in slots.values()]
    accepted = [r for one in tried for r in one if r["outcome"] == "accepted"]
    return [one[0] for one in tried], accepted


def summarise(groups: Sequence[Group]) -> dict[str, Any]:
    """What report.html shows of some cells, unpacked cell by cell to bound memory."""
    steps, spent, lost = 0, 0.0, Counter[str]()
    moves = defaultdict[tuple[int, float], tuple[list[Row], list[Row]]](lambda: ([], []))
    speeds = defaultdict[tuple[int, float], list[EpisodeFacts]](list)
    for group in groups:
        kind, rows = (group.cell.level, group.cell.alpha), group.attempts.to_pylist()
        for row in rows:
            steps += row["sim_steps"] or 0
            spent += row["seconds"] or 0.0
            if row["outcome"] != "accepted":
                lost[f"{row['stage']}: {row['reason']}".replace("_", " ")] += 1
        for of_kind, motions in zip(moves[kind], drawn_and_accepted(rows), strict=True):
            of_kind += [{name: row[name] for name in MOTION} for row in motions]
        if all(kind):
            speeds[kind] += group.episodes
    seen = [episode for group in groups for episode in group.episodes]
    count, seconds = sum(group.attempts.num_rows for group in groups), sum(e.seconds for e in seen)
    won = count - lost.total()
    tiles = {
        "episodes": f"{len(seen):,}",
        "attempts": f"{count:,}",
        "attempts accepted": f"{100 * won / count:.1f} %" if count else "none",
        "of data": f"{seconds / 3600:.2f} h" if seconds >= 360 else f"{seconds / 60:.1f} min",
        "physics steps": f"{steps:,}",
        "spent on attempts": f"{spent / 3600:.2f} h" if spent >= 3600 else f"{spent:.1f} s",
    }
    if seen and spent:
        tiles["spent an episode"] = f"{spent / len(seen):.2f} s"
    numbers = {name: len({getattr(group.cell, name) for group in groups}) for name in PLACE}
    numbers["cell"] = len(groups)
    words = [f"{number} {name}{'' if number == 1 else 's'}" for name, number in numbers.items()]
    failures = sorted(lost.items(), key=lambda item: (-item[1], item[0]))
    outcomes = [("accepted", won, True), *((*item, False) for item in failures)]
    histograms = [
        (level, speed_histogram(mine, alpha))
        for (level, alpha), mine in sorted(speeds.items())
        if mine
    ]
    laws = [
        (f"level {level}, alpha {alpha:g}", law(drawn), law(accepted))
        for (level, alpha), (drawn, accepted) in sorted(moves.items())
        if drawn
    ]
    return {
        "scope": f"{', '.join(words[:-1])}: {words[-1]}",
        "tiles": tiles,
        "outcomes": outcomes if count else [],
        "speeds": histograms,
        "moves": laws,
    }


def speed_histogram(
    episodes: Sequence[EpisodeFacts], alpha: float, bins: int = 24
) -> dict[str, Any]:
    """Counts of average and maximum speeds in bins from 0 to `top` m/s."""
    average, maximum = ([*each] for each in zip(*(e[2:] for e in episodes), strict=True))
    top = max([alpha, *average, *maximum, 1e-3]) * 1.08
    counts = [np.histogram(s, bins, (0, top))[0].tolist() for s in (average, maximum)]
    return {
        "episodes": len(episodes),
        "mean": float(np.mean(average)),
        "largest": max(maximum),
        "top": top,
        "alpha": alpha,
        "average": counts[0],
        "maximum": counts[1],
    }

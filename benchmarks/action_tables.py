"""The tables of `benchmarks.actions`: what each representation of an action loses, and where."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pipeline.evaluate.scoring.statistics import wilson

type Row = dict[str, Any]
"""A replay: its scene, what was replayed, whether it succeeded and how far its tools strayed. A
scene that the expert does not solve has one row, with the reason as `skipped`."""


class ReplayedScene(NamedTuple):
    """Which scene is replayed."""

    task: str
    robot: str
    level: int
    slot: int


def scene_of(row: Row) -> ReplayedScene:
    """The scene of a row."""
    return ReplayedScene(*(row[name] for name in ReplayedScene._fields))


def tables(rows: Sequence[Row]) -> str:
    """Markdown: success and tracking error by representation, then what each loses and where."""
    skipped = [row for row in rows if "skipped" in row]
    rows = [row for row in rows if "skipped" not in row]
    solved = {scene_of(row) for row in rows if _is_base(row) and row["success"]}
    scenes = {scene_of(row) for row in rows}
    parts = [
        f"{len(scenes)} scenes, of which the replay of joints solves {len(solved)}; {len(skipped)}"
        f" more have none that the expert solves; {sum(row['seconds'] for row in rows):.0f} s of"
        " processor time for the replays."
    ]
    for noise in (False, True):
        kept = [row for row in rows if row["noise"] == noise]
        parts += [f"{'With' if noise else 'Without'} noise:", _by_representation(kept, solved)]
    quiet = [row for row in rows if not row["noise"] and scene_of(row) in solved]
    for column in ("robot", "level", "task"):
        parts += [
            f"Success in the scenes that joints solve, in %, by {column}, without noise:",
            _by_column(quiet, column),
        ]
    lost = [
        f"- {' '.join(map(str, scene_of(row)))}: {_kind(row)}, {1000 * row['metres']:.1f} mm,"
        f" {row['unreachable']} poses out of reach"
        for row in quiet
        if not row["success"]
    ]
    return "\n\n".join([*parts, "Lost replays:", "\n".join(lost) or "none"])


def _by_representation(rows: Sequence[Row], solved: set[ReplayedScene]) -> str:
    lines = [
        "| actions | chunk | replays | success, % | 95 % interval | of those joints solve, % |"
        " tool error, median mm | 95th percentile, mm | worst mm | median mrad |"
        " poses out of reach |",
        "|---|---:|---:|---:|---|---:|---:|---:|---:|---:|---:|",
    ]
    for (actions, chunk), group in _groups(rows, "actions", "chunk").items():
        count = sum(row["success"] for row in group)
        low, high = wilson(count, len(group))
        of = [row["success"] for row in group if scene_of(row) in solved]
        metres = np.array([row["metres"] for row in group]) * 1000
        turns = np.array([row["radians"] for row in group]) * 1000
        lines.append(
            f"| `{actions}` | {chunk} | {len(group)} | {100 * count / len(group):.1f} |"
            f" {100 * low:.1f}-{100 * high:.1f} | {100 * np.mean(of) if of else 0:.1f} |"
            f" {np.median(metres):.2f} | {np.quantile(metres, 0.95):.2f} | {metres.max():.2f} |"
            f" {np.median(turns):.2f} | {sum(row['unreachable'] for row in group)} |"
        )
    return "\n".join(lines)


def _by_column(rows: Sequence[Row], column: str) -> str:
    kinds = list(_groups(rows, "actions", "chunk"))
    heads = [f"`{actions}` {chunk}" for actions, chunk in kinds]
    lines = [f"| {' | '.join([column, 'scenes', *heads])} |", f"|---{'|---:' * (len(kinds) + 1)}|"]
    for (value,), group in sorted(_groups(rows, column).items()):
        cells = _groups(group, "actions", "chunk")
        shares = [100 * np.mean([row["success"] for row in cells[kind]]) for kind in kinds]
        count = len({scene_of(row) for row in group})
        lines.append(f"| {value} | {count} | {' | '.join(f'{share:.0f}' for share in shares)} |")
    return "\n".join(lines)


def _groups(rows: Sequence[Row], *columns: str) -> dict[tuple[Any, ...], list[Row]]:
    out = defaultdict[tuple[Any, ...], list[Row]](list)
    for row in rows:
        out[tuple(row[column] for column in columns)].append(row)
    return out


def _kind(row: Row) -> str:
    return f"`{row['actions']}` in chunks of {row['chunk']}"


def _is_base(row: Row) -> bool:
    return row["actions"] == "joints" and not row["noise"]

"""The results of a ladder: seeds summed up, and the table."""

from collections.abc import Sequence
from typing import Any

from pipeline.evaluate.intervals import wilson

Row = dict[str, Any]

KEYS = ("task", "embodiment", "alpha", "level", "inputs", "chunk", "execute", "demonstrations")


def summary(rows: Sequence[Row]) -> list[Row]:
    """Rows of all seeds of a network together: successes of episodes, with Wilson's interval over the episodes, and the success
    rate of each seed."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in KEYS), []).append(row)
    out = []
    for key, group in groups.items():
        solved, episodes = sum(r["solved"] for r in group), sum(r["episodes"] for r in group)
        low, high = wilson(solved, episodes)
        numbers = {"success_rate": 100 * solved / episodes, "success_interval": [100 * low, 100 * high]}
        by_seed = [100 * r["solved"] / r["episodes"] for r in group]
        out.append(dict(zip(KEYS, key, strict=True)) | {"solved": solved, "episodes": episodes, **numbers, "by_seed": by_seed})
    return out


def table(rows: Sequence[Row]) -> str:
    """Markdown: networks down, levels across, per cent solved with its interval."""
    levels = sorted({row["level"] for row in rows})
    lines = [f"| task | input | chunk | executed | {' | '.join(f'level {n}' for n in levels)} |"]
    lines.append("|---|---|---:|---:|" + "---:|" * len(levels))
    for key in dict.fromkeys((r["task"], r["inputs"], r["chunk"], r["execute"]) for r in rows):
        found = {r["level"]: r for r in rows if (r["task"], r["inputs"], r["chunk"], r["execute"]) == key}
        cells = [_cell(found[n]) if n in found else "-" for n in levels]
        lines.append(f"| {' | '.join(map(str, (*key, *cells)))} |")
    return "\n".join(lines)


def _cell(row: Row) -> str:
    low, high = row["success_interval"]
    return f"{row['success_rate']:.0f} ({low:.0f}-{high:.0f})"

"""Success rate by level and alpha, as the paper plots it, as coordinates that the page draws."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.evaluate.scoring.summary import Row

WIDTH, HEIGHT = 260.0, 180.0
"""Size of the area of a panel, in the units of its picture."""

COLORS = ("#2563eb", "#d97706", "#059669", "#dc2626", "#7c3aed", "#0891b2", "#be185d", "#4d7c0f")
PARTS = ("policy", "clock", "rules", "embodiment", "domain", "condition")


@dataclass(frozen=True)
class Point:
    """Where a rate is drawn, and its interval (y grows downwards)."""

    x: float
    y: float
    low: float
    high: float


@dataclass(frozen=True)
class Line:
    """A policy in a panel."""

    label: str
    color: str
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Panel:
    """One level: ticks of alpha as (x, text), and a line a policy."""

    title: str
    ticks: tuple[tuple[float, str], ...]
    lines: tuple[Line, ...]


def panels(means: Sequence[Row]) -> list[Panel]:
    """One panel a level from the means over all tasks of summary.py. A target that stands still
    (level 0, or alpha 0) is the point at alpha 0 in every panel."""
    rows = [row for row in means if row["category"] == "all"]
    labels = _labels(rows)
    colors = {label: COLORS[i % len(COLORS)] for i, label in enumerate(dict.fromkeys(labels))}
    levels = sorted({row["level"] for row in rows if _alpha(row)}) or ([0] if rows else [])
    out = []
    for level in levels:
        named = zip(labels, rows, strict=True)
        here = [(n, row) for n, row in named if row["level"] == level or not _alpha(row)]
        alphas = sorted({_alpha(row) for _, row in here})
        most = max(alphas) or 1.0
        lines = list[Line]()
        for label, color in colors.items():
            mine = {_alpha(row): row for name, row in here if name == label}
            points = tuple(_point(WIDTH * alpha / most, mine[alpha]) for alpha in sorted(mine))
            if points:
                lines.append(Line(label, color, points))
        ticks = tuple((WIDTH * alpha / most, f"{alpha:g}") for alpha in alphas)
        out.append(Panel(f"level {level}" if level else "still", ticks, tuple(lines)))
    return out


def _alpha(row: Row) -> float:
    return float(row["alpha"]) if row["level"] else 0.0


def _point(x: float, row: Row) -> Point:
    low, high = row["success_rate_interval"]
    return Point(x, *(HEIGHT * (1 - rate / 100) for rate in (row["success_rate"], low, high)))


def _labels(rows: Sequence[Row]) -> list[str]:
    """A label for each row: the policy, and of clock, rules, robot and domain those that differ."""
    parts = [part for part in PARTS if part == "policy" or len({row[part] for row in rows}) > 1]
    return [", ".join(str(row[part]) for part in parts) for row in rows]

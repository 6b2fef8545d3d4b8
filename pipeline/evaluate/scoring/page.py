"""The page of an evaluation: one HTML file."""

from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.html import render_page

from .summary import Row

WIDTH, HEIGHT = 260.0, 180.0  # of the area of a panel, in the units of its picture

COLORS = ("#2563eb", "#d97706", "#059669", "#dc2626", "#7c3aed", "#0891b2", "#be185d", "#4d7c0f")
PARTS = ("policy", "clock", "rules", "embodiment", "domain", "condition")


Point = namedtuple("Point", "x y low high")

Line = namedtuple("Line", "label color points")
Panel = namedtuple("Panel", "title ticks lines")
"""One level: ticks of alpha as (x, text), and a line a policy."""


def panels(means: Sequence[Row]) -> list[Panel]:
    """One a level. A target that does not move is at alpha 0 in each."""
    rows = [row for row in means if row["category"] == "all"]
    parts = [part for part in PARTS if part == "policy" or len({row.get(part) for row in rows}) > 1]
    labels = [", ".join(str(row.get(part, "")) for part in parts) for row in rows]
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


type Film = tuple[str, bytes]
"""Caption and mp4."""


def page(
    cells: Sequence[Row],
    means: Sequence[Row],
    films: Sequence[Film] = (),
    code: str = "",
    benchmark: str = "",
) -> str:
    """The page's text; `cells` and `means` are those of summary.py."""
    version = f"Code {code[:12]}." if code else ""
    version += f" Benchmark {benchmark}." if benchmark else ""
    episodes = sum(cell["episodes"] for cell in cells)
    values = {"cells": cells, "means": means, "panels": panels(means), "films": films}
    values |= {"published": PUBLISHED, "episodes": episodes, "code": version}
    return render_page("pipeline.evaluate", "evaluation.html", **values)


def caption(row: Row) -> str:
    outcome = "success" if row["success"] else f"{row['failure']} ({', '.join(row['failed'])})"
    where = f"{row['task']}, level {row['level']}, alpha {row['alpha']:g}, {row['domain']}"
    where += f", seed {row['seed']}"
    truth = " (sees the truth)" if row["sees_truth"] else ""
    return f"{row['policy']}{truth}: {where}: {outcome}, MS {row['manipulation_score']:.0f}"


@dataclass(frozen=True)
class Published:
    """Per cent over the 35 tasks at level 1, by the authors."""

    model: str
    success_rate: float | None
    manipulation_score: float | None
    source: str


PUBLISHED = (
    Published("ACT, trained per task on level 0", 6.5, None, "the DOMINO paper"),
    Published("ACT, trained per task on level 1", 9.4, None, "the DOMINO paper"),
    Published("pi0.5", 9.6, 26.2, "the DOMINO paper"),
    Published("OpenVLA-OFT (Qwen3-VL)", 10.9, 30.5, "the DOMINO paper"),
    Published("PUMA", 17.2, 35.0, "the DOMINO paper"),
    Published("VLAct", 18.5, 34.2, "its authors"),
    Published("Fast-WAM", 19.9, 33.3, "its authors"),
    Published("Qwen-VLA, zero-shot", 26.6, None, "its authors"),
    Published("InternVLA-A1.5, zero-shot", 27.7, 39.8, "its authors"),
    Published("InternVLA-A1.5", 29.3, 42.5, "its authors"),
    Published("D2-VLA", 29.3, 40.6, "arXiv:2609.34792"),
    Published("DynamicWAM without flow and motion", 22.7, None, "its authors"),
    Published("DynamicWAM", 32.9, None, "one of its users"),
    Published("Long-WAM", 34.9, 45.1, "arXiv:2610.10528"),
    Published("DynamicWAM", 38.2, 53.2, "its authors"),
)

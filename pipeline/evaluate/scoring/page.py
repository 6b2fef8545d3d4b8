"""The page of one or several evaluations, one HTML file."""

import hashlib
import re
from collections import defaultdict, namedtuple
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.html import render_page

from .compare import check_one_benchmark
from .summary import CELL, Row, each_scene_once, over_tasks, scene_of, summarise


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


def film_path(out: Path, key: str) -> Path:
    return out / "films" / f"{hashlib.sha256(key.encode()).hexdigest()[:16]}.mp4"


LINE = ("policy", "rules", "embodiment", "level", "alpha", "domain", "condition")
ALL = "all tasks"

MOST_SCENES = 12  # whose films stand beside each other


BoardLine = namedtuple("BoardLine", "head task scores")
"""A policy at one level in one domain, over all tasks or on one; `scores` by clock."""

Board = namedtuple("Board", "lines clocks levels domains tasks")


def board(rows: Sequence[Row]) -> Board:
    rows = each_scene_once(rows)
    means = (mean for mean in over_tasks(rows) if mean["category"] == "all")
    groups: dict[Any, dict[str, Row]] = defaultdict(dict)
    for cell in (*summarise(rows), *means):
        groups[(*(cell[key] for key in LINE), cell.get("task", ALL))][cell["clock"]] = cell
    lines = [
        BoardLine(dict(zip(LINE, key, strict=False)), key[-1], scores)
        for key, scores in groups.items()
    ]
    lines.sort(key=lambda line: -max(score["success_rate"] for score in line.scores.values()))
    return Board(
        lines,
        sorted({row["clock"] for row in rows}, key=_clock_order),
        sorted({row["level"] for row in rows}),
        sorted({row["domain"] for row in rows}),
        [ALL, *sorted({row["task"] for row in rows})],
    )


def _clock_order(clock: str) -> tuple[int, float, str]:
    kind, _, rest = clock.partition(":")
    number = re.search(r"\d+(\.\d+)?", rest)
    rank = {"sim": 0, "latency": 2, "async": 3}.get(kind, 1)
    return rank, float(number[0]) if number else 0.0, clock


def clock_title(clock: str) -> str:
    """Paused, 100 ms, async 100 ms, else the clock's name."""
    kind, _, rest = clock.partition(":")
    if clock == "sim":
        return "paused"
    if kind in ("latency", "async") and re.fullmatch(r"\d+(\.\d+)?(:[a-z]+)?", rest):
        time, _, join = rest.partition(":")
        return " ".join(filter(None, ("async" if kind == "async" else "", f"{time} ms", join)))
    return clock


def films_of(bundles: Mapping[Path, Sequence[Row]]) -> list[tuple[str, list[tuple[Row, bytes]]]]:
    scenes: dict[Any, list[tuple[Row, Path]]] = defaultdict(list)
    for out, rows in bundles.items():
        for row in rows:
            path = film_path(out, row["key"])
            if path.is_file():
                scenes[(*scene_of(row), row["level"], row["domain"])].append((row, path))
    chosen = sorted(scenes.items(), key=lambda item: (-len(item[1]), str(item[0])))[:MOST_SCENES]
    return [
        (
            f"{task} on {robot}, level {level}, {domain}, seed {seed}",
            [(row, path.read_bytes()) for row, path in films],
        )
        for (task, robot, seed, level, domain), films in chosen
    ]


def board_page(
    bundles: Mapping[Path, Sequence[Row]], faults: Mapping[Path, Sequence[str]] | None = None
) -> str:
    """The page's text; `faults` are those of check-result. Raises CompareError for two
    benchmarks."""
    rows = each_scene_once([row for of_bundle in bundles.values() for row in of_bundle])
    faults = faults or {}
    checks = [(out.name, len(bundles[out]), "; ".join(f[:3]), len(f)) for out, f in faults.items()]
    return render_page(
        "pipeline.evaluate",
        "board.html",
        board=board(rows),
        cells=sorted(summarise(rows), key=lambda cell: [str(cell[key]) for key in CELL]),
        benchmark=check_one_benchmark(rows),
        films=films_of(bundles),
        checks=checks,
        episodes=len(rows),
        published=PUBLISHED,
        clock_title=clock_title,
    )

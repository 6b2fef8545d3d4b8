"""One table of evaluations: a line a policy, a column a clock."""

import re
from collections import defaultdict, namedtuple
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.html import render_page

from .evaluate import film_path
from .scoring.compare import check_one_benchmark
from .scoring.page import PUBLISHED
from .scoring.summary import Row, each_scene_once, over_tasks, scene_of, summarise

LINE = ("policy", "rules", "embodiment", "level", "alpha", "domain", "condition")
ALL = "all tasks"

MOST_SCENES = 12  # whose films stand beside each other


BoardLine = namedtuple("BoardLine", "head task scores sees_truth own_process")
"""A policy at one level in one domain, over all tasks or on one; `scores` by clock."""

Board = namedtuple("Board", "lines clocks levels domains tasks")


def board(rows: Sequence[Row]) -> Board:
    rows = each_scene_once(rows)
    means = (mean for mean in over_tasks(rows) if mean["category"] == "all")
    cells = [(cell, cell["task"], "success_interval") for cell in summarise(rows)]
    cells += [(mean, ALL, "success_rate_interval") for mean in means]
    groups: dict[Any, dict[str, Row]] = defaultdict(dict)
    for cell, task, interval in cells:
        scores = groups[(*(cell[key] for key in LINE), task)]
        scores[cell["clock"]] = cell | {"interval": cell[interval]}
    lines = [
        BoardLine(
            dict(zip(LINE, key, strict=False)),
            key[-1],
            scores,
            any(score["sees_truth"] for score in scores.values()),
            not any("evaluator" in score["process"] for score in scores.values()),
        )
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


def board_page(bundles: Mapping[Path, Sequence[Row]], faults: Mapping[Path, Sequence[str]]) -> str:
    """The page's text; `faults` are those of check-result. Raises CompareError for two
    benchmarks."""
    rows = [row for of_bundle in bundles.values() for row in of_bundle]
    benchmark = check_one_benchmark(rows)
    checks = [(out.name, len(bundles[out]), "; ".join(f[:3]), len(f)) for out, f in faults.items()]
    return render_page(
        "pipeline.evaluate",
        "board.html",
        board=board(rows),
        benchmark=benchmark,
        films=films_of(bundles),
        checks=checks,
        episodes=len(each_scene_once(rows)),
        published=PUBLISHED,
        clock_title=clock_title,
    )

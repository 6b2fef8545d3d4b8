"""The results of a ladder: seeds summed up, the file they are kept in, and the table."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from pipeline.data.atomic import write_atomic
from pipeline.data.errors import DominoError
from pipeline.data.parsing import read_json
from pipeline.evaluate.scoring.statistics import clustered
from pipeline.html import markdown

KEYS = (
    "task",
    "embodiment",
    "alpha",
    "level",
    "inputs",
    "chunk",
    "execute",
    "demonstrations",
    "round",
    "actions",
)


RESULTS = "ladder.json"
"""Name of the file of results."""


class LadderScore(TypedDict):
    """How many episodes of a cell networks of one kind solved, after how many rounds of
    corrections."""

    task: str
    embodiment: str
    alpha: float
    level: int
    inputs: str
    chunk: int
    execute: int
    demonstrations: int
    round: NotRequired[int]
    actions: NotRequired[str]
    solved: int
    episodes: int


class LadderResult(LadderScore):
    """The score of all networks of a kind, one a seed: their rate, an interval clustered by scene,
    and each seed's rate, in per cent."""

    success_rate: float
    success_interval: list[float]
    by_seed: list[float]


class ResultsFileError(DominoError):
    """A file that holds no results of a ladder."""


class Tried(LadderScore):
    """The score of one network, and the seeds of the scenes that it solved."""

    solved_seeds: list[int]


def summary(rows: Sequence[Tried]) -> list[LadderResult]:
    """Rows of all seeds of a network together: successes of episodes, with an interval clustered by
    scene (the networks of all seeds try the same ones), and the success rate of each seed."""
    groups: dict[tuple[Any, ...], list[Tried]] = {}
    for row in rows:
        groups.setdefault(_key(row), []).append(row)
    out = list[LadderResult]()
    for group in groups.values():
        solved, episodes = sum(r["solved"] for r in group), sum(r["episodes"] for r in group)
        low, high = clustered(_by_scene(group))
        of: LadderScore = {key: value for key, value in group[0].items() if key != "solved_seeds"}  # pyright: ignore[reportAssignmentType]
        rate, by_seed = 100 * solved / episodes, [100 * r["solved"] / r["episodes"] for r in group]
        interval = [100 * low, 100 * high]
        out.append(
            {
                **of,
                "solved": solved,
                "episodes": episodes,
                "success_rate": rate,
                "success_interval": interval,
                "by_seed": by_seed,
            }
        )
    return out


def _by_scene(group: Sequence[Tried]) -> list[tuple[int, int]]:
    """Of every scene that these networks tried, how many solved it and how many tried it."""
    solved = Counter(scene for row in group for scene in row["solved_seeds"])
    return [(solved[n], len(group)) for n in solved] + [(0, len(group))] * (
        group[0]["episodes"] - len(solved)
    )


def table(rows: Sequence[LadderResult]) -> str:
    """Markdown: networks down, levels across, per cent solved with its interval."""
    levels, rounds = sorted({row["level"] for row in rows}), any(map(_round, rows))
    several = len({row.get("actions", "") for row in rows}) > 1
    heads = [
        "task",
        "input",
        "chunk",
        "executed",
        *(["round"] * rounds),
        *(["actions"] * several),
        *(f"level {n}" for n in levels),
    ]
    lines = [f"| {' | '.join(heads)} |", "|---|---|" + "---:|" * (len(heads) - 2)]
    by_key = dict[tuple[str | int, ...], dict[int, LadderResult]]()
    for row in rows:
        key = (row["task"], row["inputs"], row["chunk"], row["execute"], *([_round(row)] * rounds))
        key += (row.get("actions", "joints-relative"),) * several
        by_key.setdefault(key, {})[row["level"]] = row
    for key, by_level in by_key.items():
        cells = [_cell(by_level[n]) if n in by_level else "-" for n in levels]
        lines.append(f"| {' | '.join(map(markdown, (*key, *cells)))} |")
    return "\n".join(lines)


def _round(row: LadderResult) -> int:
    return row.get("round", 0)


def _cell(row: LadderResult) -> str:
    low, high = row["success_interval"]
    return f"{row['success_rate']:.0f} ({low:.0f}-{high:.0f})"


def read_results(path: Path) -> tuple[list[LadderResult], str]:
    """The results in a file, and the version of the program that found them. Raises
    ResultsFileError in one line for a file that is none."""
    try:
        values = read_json(path)
        rows, code = values["results"], str(values["code"])
        table(rows)
        if not rows:
            raise ValueError("it has no row")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultsFileError(
            f"{path}: is no results file of domino-data ladder ({error}); it is OUT/{RESULTS}"
        ) from error
    return rows, code


def write_results(path: Path, rows: Sequence[LadderResult], code: str) -> None:
    """Write the rows of a summary with the version of the program that found them.

    Rows of the file about other cells and networks stay if they are of the same version."""
    kept = list[LadderResult]()
    if path.exists():
        before, version = read_results(path)
        found = {_key(row) for row in rows}
        kept = [row for row in before if version == code and _key(row) not in found]
    write_atomic(
        path, (json.dumps({"code": code, "results": [*kept, *rows]}, indent=1) + "\n").encode()
    )


def _key(row: LadderScore) -> tuple[Any, ...]:
    return tuple(row.get(key, 0) for key in KEYS)

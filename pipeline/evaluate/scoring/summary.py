"""Rates with intervals: of a cell, and means over tasks."""

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from .statistics import bootstrap, wilson

CELL = ("policy", "clock", "rules", "task", "embodiment", "level", "alpha", "domain", "condition")

MOST_FAULTS = 5

Row = dict[str, Any]


def scene_of(row: Row) -> tuple[str, str, int]:
    """Task, robot and seed name a scene whatever its level, alpha, domain and policy."""
    return row["task"], row["embodiment"], row["seed"]


def each_scene_once(rows: Sequence[Row]) -> list[Row]:
    """The last row of a policy, clock and rules on a scene."""
    scenes = {(*json.loads(row["key"])[1:5], row["rules"]): row for row in rows}
    return [*scenes.values()]


def summarise(rows: Sequence[Row]) -> list[Row]:
    groups: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in rows:
        groups[tuple(row.get(key, "") for key in CELL)].append(row)
    return [
        dict(zip(CELL, key, strict=True))
        | {"category": group[0]["category"]}
        | scores([group])
        | _details(group)
        for key, group in groups.items()
    ]


def over_tasks(rows: Sequence[Row]) -> list[Row]:
    """Means of cells over tasks, all and by category."""
    cells: dict[tuple[Any, ...], dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    by = [key for key in CELL if key != "task"]
    for row in rows:
        for category in ("all", row["category"]):
            cells[(*(row.get(key, "") for key in by), category)][row["task"]].append(row)
    return [
        dict(zip((*by, "category"), key, strict=True))
        | {"tasks": len(tasks)}
        | scores([*tasks.values()])
        for key, tasks in cells.items()
    ]


MEANS = {
    "success_rate": "success",
    "route_completion": "route_completion",
    "manipulation_score": "manipulation_score",
}
"""Fields of a row by the name of their mean."""


def scores(tasks: Sequence[Sequence[Row]]) -> Row:
    """Means over tasks of the rows of each. Wilson's interval of success is for T^2 / sum(1/n)
    episodes; that of other scores a bootstrap inside each task."""
    every = [row for rows in tasks for row in rows]
    out: Row = {"episodes": len(every)}
    for name, field in MEANS.items():
        values = [[float(row[field]) for row in rows] for rows in tasks]
        out[name] = float(np.mean([np.mean(each) for each in values]))
        out[f"{name}_interval"] = list(bootstrap(*values))
    effective = len(tasks) ** 2 / sum(1 / len(rows) for rows in tasks)
    ends = wilson(out["success_rate"] * effective, effective)
    out |= {"success_rate": 100 * out["success_rate"]}
    out["success_rate_interval"] = [100 * end for end in ends]
    processes = sorted({row.get("process", "evaluator") for row in every})
    truth = any(row["sees_truth"] for row in every)
    return out | {"sees_truth": truth, "process": ", ".join(processes)}


def _details(rows: Sequence[Row]) -> Row:
    holds = [row["hold"] for row in rows if row.get("hold") is not None]
    out: Row = {
        "solved_seeds": sorted(row["seed"] for row in rows if row["success"]),
        "hold": float(np.mean(holds)) if holds else None,
        "failures": _count(row["failure"] for row in rows),
        "failed_conditions": _count(name for row in rows for name in row["failed"]),
        "penalties": _count(name for row in rows for name in row["penalties"]),
        "faults": _count((row.get("fault", "") for row in rows), MOST_FAULTS),
        "other_start": sum(not row["same_start"] for row in rows),
    }
    if any("unreachable" in row for row in rows):
        out["unreachable"] = sum(row.get("unreachable", 0) for row in rows)
    return out


def _count(names: Iterable[str], most: int | None = None) -> dict[str, int]:
    return dict(Counter(filter(None, names)).most_common(most))

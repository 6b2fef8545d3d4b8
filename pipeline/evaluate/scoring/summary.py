"""Rates with intervals: of a cell, and means over tasks."""

import json
from collections import Counter, defaultdict
from collections.abc import Sequence
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
        dict(zip(CELL, key, strict=True)) | {"category": group[0]["category"]} | numbers(group)
        for key, group in groups.items()
    ]


def numbers(rows: Sequence[Row]) -> Row:
    successes = sum(row["success"] for row in rows)
    low, high = wilson(successes, len(rows))
    out: Row = {
        "episodes": len(rows),
        "success_rate": 100 * successes / len(rows),
        "success_interval": [100 * low, 100 * high],
    }
    out["solved_seeds"] = sorted(row["seed"] for row in rows if row["success"])
    for key in ("route_completion", "manipulation_score"):
        values = [row[key] for row in rows]
        out |= {key: float(np.mean(values)), f"{key}_interval": list(bootstrap(values))}
    holds = [row["hold"] for row in rows if row.get("hold") is not None]
    out["hold"] = float(np.mean(holds)) if holds else None
    failures = Counter(row["failure"] for row in rows if row["failure"])
    conditions = Counter(name for row in rows for name in row["failed"])
    if any("unreachable" in row for row in rows):
        out["unreachable"] = sum(row.get("unreachable", 0) for row in rows)
    faults = Counter(row["fault"] for row in rows if row.get("fault"))
    return out | {
        "failures": dict(failures.most_common()),
        "failed_conditions": dict(conditions.most_common()),
        "penalties": dict(Counter(name for row in rows for name in row["penalties"])),
        "faults": dict(faults.most_common(MOST_FAULTS)),
        "other_start": sum(not row["same_start"] for row in rows),
        "sees_truth": any(row["sees_truth"] for row in rows),
        "process": _processes(rows),
    }


def over_tasks(rows: Sequence[Row]) -> list[Row]:
    """Means of cells over tasks, all and by category. Wilson's interval of success is for T^2 /
    sum(1/n) episodes; that of scores a bootstrap inside each task."""
    cells: dict[tuple[Any, ...], dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    by = [key for key in CELL if key != "task"]
    for row in rows:
        for category in ("all", row["category"]):
            cells[(*(row.get(key, "") for key in by), category)][row["task"]].append(row)
    out = []
    for key, tasks in cells.items():
        values = {
            name: [[float(row[field]) for row in group] for group in tasks.values()]
            for name, (field, _) in MEANS.items()
        }
        means: Row = {
            name: MEANS[name][1] * float(np.mean([np.mean(v) for v in groups]))
            for name, groups in values.items()
        }
        rate = means["success_rate"] / 100
        effective = len(tasks) ** 2 / sum(1 / len(group) for group in tasks.values())
        intervals = {
            f"{name}_interval": list(_stratified_interval(groups))
            for name, groups in values.items()
        }
        intervals["success_rate_interval"] = [100 * x for x in wilson(rate * effective, effective)]
        head = dict(zip((*by, "category"), key, strict=True))
        counts = {"tasks": len(tasks), "episodes": sum(map(len, tasks.values()))}
        every = [row for group in tasks.values() for row in group]
        truth = {"sees_truth": any(row["sees_truth"] for row in every)}
        truth |= {"process": _processes(every)}
        out.append(head | counts | truth | means | intervals)
    return out


def _processes(rows: Sequence[Row]) -> str:
    return ", ".join(sorted({row.get("process", "evaluator") for row in rows}))


MEANS = {
    "success_rate": ("success", 100.0),
    "route_completion": ("route_completion", 1.0),
    "manipulation_score": ("manipulation_score", 1.0),
}
"""Fields of a row, and what their means are multiplied by."""


def _stratified_interval(groups: Sequence[Sequence[float]]) -> tuple[float, float]:
    rng, means = np.random.default_rng(0), np.zeros(2000)
    for group in groups:
        values = np.sort(np.asarray(group, float))
        means += values[rng.integers(len(values), size=(len(means), len(values)))].mean(1)
    low, high = np.quantile(means / len(groups), [0.025, 0.975])
    return float(low), float(high)

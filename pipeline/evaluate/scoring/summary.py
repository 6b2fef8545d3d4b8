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


def two_by_two(means: Sequence[Row]) -> list[str]:
    """Lines of a table of success rates (per cent) under two conditions, and their interaction."""
    groups: dict[tuple[Any, ...], dict[str, float]] = defaultdict(dict)
    for mean in means:
        if mean["category"] == "all":
            key = tuple(mean[name] for name in CELL if name not in ("task", "condition"))
            groups[key][mean["condition"]] = mean["success_rate"]
    out = list[str]()
    for key, rates in groups.items():
        one, _, two = max(rates, key=lambda name: name.count("+")).partition("+")
        if "+" in two or {*rates} != {"none", one, two, f"{one}+{two}"}:
            continue
        neither, first, second, both = (rates[n] for n in ("none", one, two, f"{one}+{two}"))
        out += [
            f"SR %, {key[0]}, level {key[4]}{'':10}no {two:10} {two}",
            f"{'no ' + one:>30} {neither:10.1f} {second:10.1f}",
            f"{one:>30} {first:10.1f} {both:10.1f}",
            f"{'interaction':>30} {both - first - second + neither:+10.1f} points",
        ]
    return out


def by_clock(cells: Sequence[Row], means: Sequence[Row]) -> list[str]:
    """Lines of a table of success rates (per cent) by clock, and what the first clock hides."""
    clocks = [*dict.fromkeys(row["clock"] for row in cells)]
    names = {"sim": "paused"} | {c: f"{c.removeprefix('latency:')} ms" for c in clocks[1:]}
    apart = [key for key in CELL if key != "clock"]
    groups: dict[tuple[Any, ...], dict[str, float]] = defaultdict(dict)
    for row in [*cells, *(mean for mean in means if mean["category"] == "all")]:
        key = tuple(row.get(name, f"mean of {row.get('tasks')} tasks") for name in apart)
        groups[key][row["clock"]] = row["success_rate"]
    out = ["SR %".ljust(56) + "".join(f"{names.get(clock, clock):>14}" for clock in clocks)]
    for key, rates in groups.items():
        of = dict(zip(apart, key, strict=True))
        where = f" [{of['condition']}]" if of["condition"] else ""
        head = f"{of['task']:28} {of['embodiment']:14} level {of['level']}{where}"
        out.append(f"{head:56}" + "".join(f"{rates[clock]:14.1f}" for clock in clocks))
    first, *others = (
        np.mean([row["success_rate"] for row in cells if row["clock"] == clock]) for clock in clocks
    )
    lost = [f"{first - x:.1f} at {names[c]}" for c, x in zip(clocks[1:], others, strict=True)]
    return [*out, f"What {names.get(clocks[0], clocks[0])} hides, in points: {', '.join(lost)}"]


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


WORDS = ("rules", "condition")  # columns of `table` that are as wide as their longest word


def table(cells: Sequence[Row]) -> str:
    """Format cells as aligned text. `truth` marks policies that are shown the simulation."""
    width = {name: max(map(len, (name, *(c[name] for c in cells)))) for name in WORDS}
    conditions = any(c["condition"] for c in cells)
    head = (
        f"{'task':28} {'robot':14} {'L':>1} {'alpha':>5} {'domain':10}"
        f" {'rules':{width['rules']}} {'truth':5} {'process':9} {'n':>4}"
    )
    head = f"{'condition':{width['condition']}} {head}" if conditions else head
    lines = [f"{head}  SR % (95 %)        RC     MS  hold s  failures"]
    for c in cells:
        low, high = c["success_interval"]
        why = ", ".join(f"{name} {n}" for name, n in c["failures"].items())
        if c.get("unreachable"):
            why += f"{', ' if why else ''}unreachable poses {c['unreachable']}"
        scores = f"{c['route_completion']:6.1f} {c['manipulation_score']:6.1f}"
        hold = "-" if c["hold"] is None else f"{c['hold']:.2f}"
        start = f"{c['condition']:{width['condition']}} " if conditions else ""
        lines.append(
            f"{start}{c['task']:28} {c['embodiment']:14} {c['level']} {c['alpha']:5g}"
            f" {c['domain']:10} {c['rules']:{width['rules']}}"
            f" {'sees' if c['sees_truth'] else '-':5} {c['process']:9}"
            f" {c['episodes']:4}  {c['success_rate']:5.1f} ({low:4.1f}-{high:5.1f}) {scores} "
            f" {hold:>6}  {why}"
        )
    return "\n".join(lines)

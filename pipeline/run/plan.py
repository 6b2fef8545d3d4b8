"""`domino-data plan` and `status`: what a recipe asks for, what is there, and what the rest will cost. Writes nothing."""

from collections import Counter
from dataclasses import asdict
from typing import Any

from pipeline.data.dataset import Dataset
from pipeline.data.pairs import pairs_in
from pipeline.data.recipe import Recipe
from pipeline.run.cost import Cost, cost_of
from pipeline.run.floor import stops_in
from pipeline.run.reasons import reasons
from pipeline.run.state import DONE, OPEN, states


def plan(
    recipe: Recipe, dataset: Dataset | None, workers: int, cost: Cost | None = None, price: float | None = None
) -> dict[str, Any]:
    """Cells with wanted and finished slots; estimated hours, core-hours and bytes of the rest from a `cost`, by default that of the
    dataset's own record if it has one; what the core-hours cost at a price for one."""
    records = dict(dataset.records(recipe)) if dataset is not None and dataset.manifest.exists() else {}
    done = Counter(slot.cell for slot in records)
    cost = cost or cost_of(dataset, recipe)
    cells = [
        {"task": c.task, "embodiment": c.embodiment, "level": c.level, "alpha": c.alpha, "domain": c.domain}
        | {"episodes": count * recipe.variants, "finished": done[c]}
        for c, count in recipe.counts().items()
    ]
    slots = sum(c["episodes"] for c in cells)
    left = slots - len(records)
    return {
        "cells": cells,
        "slots": slots,
        "finished": len(records),
        "workers": workers,
        "estimated_hours": cost.hours(left, workers),
        "estimated_core_hours": cost.core_hours(left),
        "estimated_cost": None if price is None else cost.core_hours(left) * price,
        "estimated_bytes": int(left * cost.size),
        "estimated_bytes_by_part": {name: int(left * size) for name, size in cost.parts.items()},
        "estimate_from": cost.source,
        "estimate": cost.said(left, workers),
    }


def status(dataset: Dataset) -> dict[str, Any]:
    """Slots wanted, accepted, given up and open; attempts, their failures by reason, and these in detail (`failures`, as Reason);
    per cell the same; and `redo`: what a build would make again of what is there, and because of which changes, as {"what",
    "because", "slots"}; `pairs` (as Pairs) where the recipe pairs cells; `stopped`: the cells that the recipe's floor stops, as
    {"cell", "slots", "because"}."""
    recipe = dataset.recipe()
    redo = Counter((state.todo, state.because) for _, state in states(dataset, recipe) if state.todo not in (DONE, OPEN))
    cells: dict[str, Counter[str]] = {c.path: Counter(wanted=n * recipe.variants) for c, n in recipe.counts().items()}
    rows: list[dict[str, Any]] = []
    for slot, record in dataset.records(recipe):
        count = cells[slot.cell.path]
        count["accepted" if record.accepted else "given_up"] += 1
        count["attempts"] += len(record.attempts)
        count["solved"] += record.accepted and not slot.variant
        rows += record.attempts
    total = sum(cells.values(), Counter())
    summary = {key: total[key] for key in ("wanted", "accepted", "given_up", "attempts")}
    rate = total["solved"] / total["attempts"] if total["attempts"] else None
    keys = ("wanted", "accepted", "given_up", "attempts")
    return summary | {
        "open": total["wanted"] - total["accepted"] - total["given_up"],
        "attempt_success": rate,
        "reasons": dict(Counter(row["reason"] for row in rows if row["reason"]).most_common()),
        "failures": [asdict(reason) for reason in reasons(rows)],
        "pairs": asdict(pairs) if (pairs := pairs_in(dataset, recipe)) else None,
        "stopped": [{"cell": s.cell.path, "slots": s.slots, "because": s.because} for s in stops_in(dataset, recipe)],
        "redo": [{"what": what, "because": list(because), "slots": n} for (what, because), n in sorted(redo.items())],
        "cells": {path: {key: count[key] for key in keys} for path, count in cells.items()},
    }

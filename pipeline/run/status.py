"""`domino-data status`: what a dataset holds, by its ledger and a listing of its episode files. Opens no episode."""

from collections import Counter
from dataclasses import asdict
from typing import Any

import pyarrow as pa

from pipeline.data.dataset import Dataset
from pipeline.data.pairs import pairs_in
from pipeline.run.floor import stops_in
from pipeline.run.reasons import reasons
from pipeline.run.state import DONE, OPEN, entry_states


def status(dataset: Dataset) -> dict[str, Any]:
    """Slots wanted, accepted, given up and open; attempts, their failures by reason, and these in detail (`failures`, as Reason);
    per cell the same; and `redo`: what a build would make again of what is there, and because of which changes, as {"what",
    "because", "slots"}; `pairs` (as Pairs) where the recipe pairs cells; `stopped`: the cells that the recipe's floor stops, as
    {"cell", "slots", "because"}."""
    recipe = dataset.recipe()
    entries = dataset.entries(recipe, ("keys", "attempts"))
    todo = (state for _, state in entry_states(dataset, recipe, entries))
    redo = Counter((state.todo, state.because) for state in todo if state.todo not in (DONE, OPEN))
    there = dataset.present(entries)
    tried = there.table["attempts"].combine_chunks()
    numbers = tried.value_lengths().to_pylist()
    cells: dict[str, Counter[str]] = {c.path: Counter(wanted=n * recipe.variants) for c, n in recipe.counts().items()}
    paths = {c: c.path for c in recipe.counts()}
    for slot, accepted, number in zip(there.slots, there.accepted, numbers, strict=True):
        count = cells[paths[slot.cell]]
        count["accepted" if accepted else "given_up"] += 1
        count["attempts"] += number
        count["solved"] += accepted and not slot.variant
    total = sum(cells.values(), Counter())
    summary = {key: total[key] for key in ("wanted", "accepted", "given_up", "attempts")}
    rate = total["solved"] / total["attempts"] if total["attempts"] else None
    keys = ("wanted", "accepted", "given_up", "attempts")
    rows = _failed(tried.flatten())
    return summary | {
        "open": total["wanted"] - total["accepted"] - total["given_up"],
        "attempt_success": rate,
        "reasons": dict(Counter(row["reason"] for row in rows).most_common()),
        "failures": [asdict(reason) for reason in reasons(rows)],
        "pairs": asdict(pairs) if (pairs := pairs_in(dataset, recipe)) else None,
        "stopped": [{"cell": s.cell.path, "slots": s.slots, "because": s.because} for s in stops_in(dataset, recipe)],
        "redo": [{"what": what, "because": list(because), "slots": n} for (what, because), n in sorted(redo.items())],
        "cells": {path: {key: count[key] for key in keys} for path, count in cells.items()},
    }


def _failed(attempts: pa.StructArray) -> list[dict[str, Any]]:
    """The failed attempts, only the columns that `reasons` reads."""
    names = ("stage", "reason", "detail", "conditions")
    table = pa.table({name: attempts.field(name) for name in names})
    failed = [bool(reason) for reason in table["reason"].to_pylist()]
    return table.filter(pa.array(failed, pa.bool_())).to_pylist()

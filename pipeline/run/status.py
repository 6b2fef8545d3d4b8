"""`domino-data status`: what a dataset holds, by its ledger and a listing of its episode files. Opens no episode."""

from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.dataset import Dataset
from pipeline.data.ledger.columns import lengths, single
from pipeline.data.ledger.entries import Entries, Files
from pipeline.data.ledger.table import ONE
from pipeline.data.pairs import pairs_in
from pipeline.run.early_stop import stopped_cells
from pipeline.run.names import installed_recipe
from pipeline.run.state import redo_rows, redone
from pipeline.stages.reasons import reasons_in

_READ = ("seed", "outcome", "stage", "reason", "detail", "conditions")
"""Columns of the attempts that are read: what the ledger's entries are judged by, and what the reasons of failures are made of."""


def status(dataset: Dataset) -> dict[str, Any]:
    """The state of a dataset: slots wanted, accepted, given up and open; attempts and their failures by reason; the same per cell.

    `edited` tells whether its manifest was edited.

    `failures` has the reasons in detail (as Reason); `redo` the parts that a build would make again, and the changes that cause it,
    as {"what", "because", "slots"}; `pairs` (as Pairs) is there if the recipe pairs cells; `stopped` has the cells that the
    recipe's floor stops, as {"cell", "slots", "because"}.
    """
    recipe = installed_recipe(dataset)
    entries = dataset.entries(recipe, ("keys", "stamp", *(f"{ONE}{name}" for name in _READ)))
    files = Files(dataset.episodes)
    listed = files.listed(entries)
    redo = redone(recipe, entries, files.there_of(entries, listed))
    there = entries.where(listed | ~np.array(entries.accepted, bool))
    tried, accepted = single(there.table["attempts"]), np.array(there.accepted, bool)
    counted = {
        "wanted": [number * recipe.variants for number in recipe.counts().values()],
        "accepted": _by_cell(there, accepted),
        "given_up": _by_cell(there, ~accepted),
        "attempts": _by_cell(there, lengths(tried)),
    }
    total = {name: sum(counts) for name, counts in counted.items()}
    solved = int((accepted & (np.array(there.numbers[1]) == 0)).sum())
    failures = reasons_in(tried.flatten())
    by_reason = Counter[str]()
    for failure in failures:
        by_reason[failure.reason] += failure.attempts
    return total | {
        "edited": dataset.is_edited(),
        "open": total["wanted"] - total["accepted"] - total["given_up"],
        "attempt_success": solved / total["attempts"] if total["attempts"] else None,
        "reasons": dict(by_reason.most_common()),
        "failures": [asdict(reason) for reason in failures],
        "pairs": asdict(pairs) if (pairs := pairs_in(dataset, recipe)) else None,
        "stopped": [{"cell": s.cell.path, "slots": s.slots, "because": s.because} for s in stopped_cells(dataset, recipe)],
        "redo": redo_rows(redo),
        "cells": {cell.path: {name: counts[rank] for name, counts in counted.items()} for rank, cell in enumerate(there.cells)},
    }


def _by_cell(entries: Entries, values: NDArray[Any]) -> list[int]:
    """The sum of some values (N,) of the rows, for every cell."""
    return np.bincount(entries.ranks, weights=values, minlength=len(entries.cells)).astype(int).tolist()

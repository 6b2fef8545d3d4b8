"""`domino-data status`: what a dataset holds. Opens no episode."""

import json
from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.dataset import Dataset
from pipeline.data.intact import pairs_in
from pipeline.data.slots.files import Listing
from pipeline.stages.reasons import reasons_in

from .names import installed_recipe
from .state import redo_rows, redone


def status(dataset: Dataset) -> dict[str, Any]:
    """Slots wanted, accepted, given up and open; attempts and their failures by reason; the same
    per cell. `failures` has the reasons in detail (as Reason); `redo` what a build would make again
    (redo_rows); `pairs` (count_pairs) is there if the recipe pairs cells."""
    recipe = installed_recipe(dataset)
    rows = dataset.rows(recipe)
    listed = Listing(dataset.episodes, recipe).there(rows)
    redo, there = redone(recipe, rows, listed), rows.where(listed)
    of, tried = dataset.ask(
        lambda index: index.attempts(there, "stage", "reason", "detail", "conditions")
    )

    def by_cell(values: NDArray[Any]) -> list[int]:
        cells = len(there.cells)
        return np.bincount(there.ranks, weights=values, minlength=cells).astype(int).tolist()

    counted = {
        "wanted": [number * recipe.variants for number in recipe.counts().values()],
        "accepted": by_cell(there.accepted),
        "given_up": by_cell(~there.accepted),
        "attempts": by_cell(np.bincount(of, minlength=len(there))),
    }
    total = {name: sum(counts) for name, counts in counted.items()}
    solved = int((there.accepted & (there.variants == 0)).sum())
    failures = reasons_in(
        (stage, reason, detail, json.loads(names) if names and names != "[]" else ())
        for stage, reason, detail, names in tried
        if reason
    )
    by_reason = Counter[str]()
    for failure in failures:
        by_reason[failure.reason] += failure.attempts
    return total | {
        "edited": dataset.is_edited(),
        "open": total["wanted"] - total["accepted"] - total["given_up"],
        "attempt_success": solved / total["attempts"] if total["attempts"] else None,
        "reasons": dict(by_reason.most_common()),
        "failures": [asdict(reason) for reason in failures],
        "pairs": pairs_in(dataset, recipe),
        "redo": redo_rows(redo),
        "cells": {
            cell.path: {name: counts[rank] for name, counts in counted.items()}
            for rank, cell in enumerate(there.cells)
        },
    }

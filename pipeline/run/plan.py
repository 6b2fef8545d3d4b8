"""`domino-data plan`: what a recipe asks for, what is there, and what the rest will cost. Writes nothing."""

from collections import Counter
from collections.abc import Collection
from typing import Any

from pipeline.data.dataset import Dataset
from pipeline.data.errors import DominoError
from pipeline.data.ledger.entries import Files
from pipeline.data.recipe.model import Cell, Recipe
from pipeline.run.cost import Cost, cost_of
from pipeline.run.state import PHYSICS, redo_rows, redone

BOUNDS = ("tasks", "levels", "episodes", "total")
"""Keys of a recipe of which a command line must give one, unless it names a manifest: the others do not bound a build's length."""


class Unbounded(DominoError):
    """A build without a bound; the message names what it would make and the options that choose."""


def check_bounded(given: Collection[str], recipe: Recipe, dataset: Dataset, workers: int) -> None:
    """Raise Unbounded for a new dataset of a recipe of whose BOUNDS none is `given`; a dataset that exists may be resumed."""
    if any(key in given for key in BOUNDS) or dataset.manifest.exists():
        return
    values = plan(recipe, None, workers)
    raise Unbounded(
        f"this build would make {values['slots']:,} episodes, {values['estimate']}: choose with "
        f"{', '.join(f'--{key}' for key in BOUNDS)} or --manifest (for example --tasks click_bell --episodes 2), or add --yes"
    )


def plan(
    recipe: Recipe, dataset: Dataset | None, workers: int, cost: Cost | None = None, price: float | None = None
) -> dict[str, Any]:
    """The work that is left: cells with wanted and finished slots; finished parts to make again, as `status` reports them (`redo`);
    estimated hours, core-hours, their price, and bytes.

    The estimate follows from a `cost`, by default the dataset's own record if it has one; `price` is that of one core-hour."""
    done, redo = Counter[Cell](), Counter[tuple[str, tuple[str, ...]]]()
    if dataset is not None and dataset.manifest.exists():
        held, files = dataset.present(dataset.entries(recipe, ("keys", "stamp"))), Files(dataset.episodes)
        redo = redone(recipe, held, files.there_of(held, files.listed(held)))
        done = Counter(slot.cell for slot in held.slots)
    cost = cost or cost_of(dataset, recipe)
    cells = [
        {"task": c.task, "embodiment": c.embodiment, "level": c.level, "alpha": c.alpha, "domain": c.domain}
        | {"episodes": count * recipe.variants, "finished": done[c]}
        for c, count in recipe.counts().items()
    ]
    slots = sum(c["episodes"] for c in cells)
    left = slots - done.total() + sum(count for (what, _), count in redo.items() if what == PHYSICS)
    return {
        "cells": cells,
        "slots": slots,
        "finished": done.total(),
        "redo": redo_rows(redo),
        "workers": workers,
        "estimated_hours": cost.hours(left, workers),
        "estimated_core_hours": cost.core_hours(left),
        "estimated_cost": None if price is None else cost.core_hours(left) * price,
        "estimated_bytes": int(left * cost.size),
        "estimated_bytes_by_part": {name: int(left * size) for name, size in cost.parts.items()},
        "estimate_from": cost.source,
        "estimate": cost.describe(left, workers),
    }

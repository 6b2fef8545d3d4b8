"""What of a slot is done or must be made again; `domino-data status`."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.dataset import Dataset
from pipeline.data.intact import kept_failures, pairs_in
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.files import Rows
from pipeline.data.slots.records import unpack_keys
from pipeline.data.slots.reread import IndexWriter
from pipeline.data.store.place import is_there
from pipeline.poses import Bools, Ints
from pipeline.registry import UnknownName
from pipeline.stages.reasons import reasons_in

from .identity.slot_keys import RecipeKeys
from .names import installed_recipe

REDO = "episode missing or damaged"  # why a slot is made again whose keys match
NO_ASSET = "asset missing"  # the same of a slot whose images were drawn from what is not there
GONE = "failed attempt missing"  # the same of a slot whose failed attempts are kept
DONE, OPEN, PHYSICS, IMAGES, SENTENCES = "done", "open", "physics", "images", "sentences"


@dataclass(frozen=True)
class SlotState:
    """`todo` is DONE, OPEN, or what must be made again: PHYSICS, IMAGES or SENTENCES; `because`
    names the parts of the key that changed. `accepted` is the index's, None for no such slot.
    """

    todo: str
    because: tuple[str, ...] = ()
    accepted: bool | None = None


def judge_keys(recipe: Recipe, rows: Rows) -> tuple[list[SlotState], Ints]:
    """The states of groups of rows if their files are there, and the group of each (N,)."""
    keys, keeps = RecipeKeys(recipe), recipe.keep_failures != "none"
    groups = (rows.ranks * (recipe.variants + 1) + rows.variants) * 2 + rows.accepted
    groups = groups * (max(rows.texts, default=0) + 1) + rows.keys
    _, firsts, of = np.unique(groups, return_index=True, return_inverse=True)
    some = rows.where(firsts)
    columns = zip(some.slots, some.accepted.tolist(), some.keys.tolist(), strict=True)
    return [
        _against(keys, slot, accepted, rows.texts.get(key, ""), keeps)
        for slot, accepted, key in columns
    ], of


def _against(wanted: RecipeKeys, slot: Slot, accepted: bool, text: str, keeps: bool) -> SlotState:
    """The state of a slot whose file is there."""
    try:
        held = unpack_keys(slot, text)
    except (ValueError, TypeError, AttributeError, KeyError):
        return SlotState(OPEN)
    try:
        keys = wanted.of(slot)
    except UnknownName as unknown:
        return SlotState(PHYSICS, (str(unknown),), accepted)
    if changed := held.physics.changed(keys.physics):
        return SlotState(PHYSICS, tuple(changed), accepted)
    if accepted or keeps:
        images = tuple(held.render.changed(keys.render))
        sentences = tuple(held.language.changed(keys.language))
        if images or sentences:
            return SlotState(IMAGES if images else SENTENCES, images + sentences, accepted)
    return SlotState(DONE, (), accepted)


def _with_file(state: SlotState, there: bool) -> SlotState:
    if there or state.todo == PHYSICS:
        return state
    return SlotState(OPEN, (REDO,) if state.accepted else (), state.accepted)


def _states(dataset: Dataset, recipe: Recipe, rows: Rows) -> dict[Slot, SlotState]:
    there = dataset.there(recipe, rows)
    cases, of = judge_keys(recipe, rows)
    each = zip(rows.slots, of.tolist(), there.tolist(), strict=True)
    return {slot: _with_file(cases[case], here) for slot, case, here in each}


def states(dataset: Dataset, recipe: Recipe) -> Iterator[tuple[Slot, SlotState]]:
    """Every slot of a recipe with its state now, files unread."""
    found, none = _states(dataset, recipe, dataset.rows(recipe)), SlotState(OPEN)
    return ((slot, found.get(slot, none)) for slot in recipe.slots())


def missing(dataset: Dataset, recipe: Recipe, writer: IndexWriter) -> dict[Slot, SlotState]:
    """The physical slots of a recipe that are not done, in order. A file changed since the index
    read it is read again.
    """
    damaged, rows = writer.catch_up(), writer.index.rows(recipe, "assets")
    rows = rows.where(rows.variants == 0)
    found = _states(dataset, recipe, rows)
    for slot in damaged & found.keys():
        found[slot] = SlotState(PHYSICS, (REDO,), found[slot].accepted)
    there, names = AssetStore(dataset.bodies).keys(), writer.index.assets().items()
    absent = {str(number) for number, name in names if name not in there}
    for slot, named in zip(rows.slots, rows.more["assets"], strict=True) if absent else ():
        if found[slot].todo in (DONE, SENTENCES) and not absent.isdisjoint(named.split()):
            found[slot] = SlotState(IMAGES, (NO_ASSET,), True)
    if recipe.keep_failures != "none":
        for slot, path, _ in kept_failures(dataset, recipe):
            if found[slot].todo != OPEN and not is_there(path):
                found[slot] = SlotState(PHYSICS, (GONE,), found[slot].accepted)
    each = ((slot, found.get(slot, SlotState(OPEN))) for slot in recipe.physical_slots())
    return {slot: state for slot, state in each if state.todo != DONE}


def redone(recipe: Recipe, rows: Rows, there: Bools) -> list[dict[str, Any]]:
    """What of how many slots a build would make again, and why: {"what", "because", "slots"},
    sorted; `there` is (N,)."""
    (cases, of), found = judge_keys(recipe, rows), Counter[tuple[str, tuple[str, ...]]]()
    for here in (True, False):
        counts = np.bincount(of[there == here], minlength=len(cases)).tolist()
        for case, number in zip(cases, counts, strict=True):
            state = _with_file(case, here)
            if state.todo not in (DONE, OPEN):
                found[state.todo, state.because] += number
    return [
        {"what": what, "because": list(because), "slots": n}
        for (what, because), n in sorted(found.items())
        if n
    ]


def redo_lines(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """A line for each of `redone`."""
    return [
        f"a build would make the {r['what']} of {r['slots']} slots again: changed"
        f" {', '.join(r['because'])}"
        for r in rows
    ]


def status(dataset: Dataset) -> dict[str, Any]:
    """Counts of slots, attempts and failures, in total and by cell. `redo` is what a build would
    make again; `pairs` is there if cells are paired.
    """
    recipe = installed_recipe(dataset)
    rows = dataset.rows(recipe)
    listed = dataset.there(recipe, rows)
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
        "redo": redo,
        "cells": {
            cell.path: {name: counts[rank] for name, counts in counted.items()}
            for rank, cell in enumerate(there.cells)
        },
    }

"""What of a slot is done, and what a build would do again and why."""

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyarrow.compute import MatchSubstringOptions, call_function

from pipeline.data.dataset import Dataset
from pipeline.data.ledger.columns import codes, flags, numbers, parents, single
from pipeline.data.ledger.entries import Entries, Files
from pipeline.data.ledger.records import NO_RECORD
from pipeline.data.ledger.stamps import DAMAGED
from pipeline.data.ledger.table import unpack_keys
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.registry import UnknownName
from pipeline.run.identity.slot_keys import RecipeKeys

REDO = "episode missing or damaged"  # why a slot is made again whose keys match
FOUND = "episode found damaged by verify"  # the same of a slot whose episode `verify` has judged
GONE = "failed attempt missing"  # the same of a slot whose failed attempts are kept
DONE, OPEN, PHYSICS, IMAGES, SENTENCES = "done", "open", "physics", "images", "sentences"


@dataclass(frozen=True)
class SlotState:
    """`todo` is DONE, OPEN (nothing is there), or what must be made again: PHYSICS (everything), IMAGES (from the stored state
    log) or SENTENCES; `because` names the parts of the key that changed. `accepted` is what the ledger entry says, None if there
    is none; `restamp` that its episode had to be read to see that it is whole: its entry has another stamp."""

    todo: str
    because: tuple[str, ...] = ()
    accepted: bool | None = None
    restamp: bool = False


def _cases(recipe: Recipe, entries: Entries) -> tuple[list[SlotState | None], NDArray[np.int64]]:
    """The states of groups of the entries (same cell, variant, keys and outcome), and the group of every row (N,).

    They hold if the episodes are there; None if the keys cannot be read."""
    keys, accepted = RecipeKeys(recipe), np.array(entries.accepted, bool)
    numbered, texts = codes(entries.table["keys"])
    cases = entries.ranks * (recipe.variants + 1) + np.array(entries.numbers[1], np.int64)
    cases = (cases * 2 + accepted) * (len(texts) + 1) + numbered
    # `equal` would import pandas
    damaged = flags(call_function("match_like", [entries.table["stamp"]], MatchSubstringOptions(DAMAGED)))
    cases = cases * 2 + damaged
    _, firsts, of = np.unique(cases, return_index=True, return_inverse=True)
    states = list[SlotState | None]()
    for first in firsts.tolist():
        slot = Slot(entries.cells[int(entries.ranks[first])], entries.numbers[0][first], entries.numbers[1][first])
        text = texts[numbered[first]] if numbered[first] >= 0 else ""
        state = _against(keys, slot, bool(accepted[first]), text, recipe.keep_failures != "none")
        if state is not None and damaged[first] and state.todo != PHYSICS:
            state = SlotState(PHYSICS, (FOUND,), True)
        states.append(state)
    return states, of


def _state(state: SlotState | None, there: bool) -> SlotState:
    """The state of a slot of a group, by whether its episode is there."""
    if state is None:
        return SlotState(OPEN)
    if state.accepted and state.todo != PHYSICS and not there:
        return SlotState(OPEN, (REDO,), True)
    return state


def entry_states(dataset: Dataset, recipe: Recipe, entries: Entries) -> Iterator[tuple[Slot, SlotState]]:
    """Every entry's slot with its state against the keys it would have now, episodes unread. Needs `keys` and `stamp`.

    What was made for a task or robot that the code does not have is out of date. A slot that was given up has images and sentences
    only where the recipe keeps failed attempts.
    """
    files, (cases, of) = Files(dataset.episodes), _cases(recipe, entries)
    there = files.there_of(entries, files.listed(entries))
    for slot, case, here in zip(entries.slots, of.tolist(), there.tolist(), strict=True):
        yield slot, _state(cases[case], here)


def redone(recipe: Recipe, entries: Entries, there: NDArray[np.bool_]) -> Counter[tuple[str, tuple[str, ...]]]:
    """How many slots, of those that `entries` holds, a build would make again, by what of them and why: as `entry_states` says one
    by one. `keys` and `stamp` must have been read; `there` (N,) says whose episode is there."""
    (cases, of), found = _cases(recipe, entries), Counter[tuple[str, tuple[str, ...]]]()
    for here in (True, False):
        counts = np.bincount(of[there == here], minlength=len(cases)).tolist()
        for state, number in zip(cases, counts, strict=True):
            state = _state(state, here)
            if state.todo not in (DONE, OPEN):
                found[state.todo, state.because] += number
    return +found


def redo_rows(redo: Mapping[tuple[str, tuple[str, ...]], int]) -> list[dict[str, Any]]:
    """What `redone` counted as plain data: {"what", "because", "slots"}, sorted."""
    return [{"what": what, "because": list(because), "slots": n} for (what, because), n in sorted(redo.items())]


def redo_lines(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """A line for each of `redo_rows`."""
    return [f"a build would make the {r['what']} of {r['slots']} slots again: changed {', '.join(r['because'])}" for r in rows]


def _against(wanted: RecipeKeys, slot: Slot, accepted: bool, text: str, keeps: bool) -> SlotState | None:
    """The state of a slot whose episode is there; None for keys that cannot be read. `keeps`: failed attempts are files, too."""
    try:
        held = unpack_keys(slot, text)
    except NO_RECORD:
        return None
    try:
        keys = wanted.of(slot)
    except UnknownName as unknown:
        return SlotState(PHYSICS, (str(unknown),), accepted)
    if changed := held.physics.changed(keys.physics):
        return SlotState(PHYSICS, tuple(changed), accepted)
    if not (accepted or keeps):
        return SlotState(DONE, (), accepted)
    images, sentences = tuple(held.render.changed(keys.render)), tuple(held.language.changed(keys.language))
    if images:
        return SlotState(IMAGES, images + sentences, accepted)
    return SlotState(SENTENCES, sentences, accepted) if sentences else SlotState(DONE, (), accepted)


def states(dataset: Dataset, recipe: Recipe) -> Iterator[tuple[Slot, SlotState]]:
    """Every slot of a recipe with its state now, episodes unread: whether their bytes are the ledger's is for `read_states`."""
    found, none = dict(entry_states(dataset, recipe, dataset.entries(recipe, ("keys", "stamp")))), SlotState(OPEN)
    return ((slot, found.get(slot, none)) for slot in recipe.slots())


def read_states(dataset: Dataset, recipe: Recipe, slots: Iterable[Slot]) -> Iterator[tuple[Slot, SlotState]]:
    """Slots of a recipe, in order, with their states after a check of every episode file.

    A slot is to be made from scratch if its episode's bytes differ from the ledger's or a stored failure is missing. A file with
    the stamp of its entry (length and time of its last change) has not been written since; every other one is read, on as many
    threads as there are cores.
    """
    entries, wanted = dataset.entries(recipe, ("keys", "stamp", "attempts")), list(slots)
    files, (cases, of) = Files(dataset.episodes), _cases(recipe, entries)
    there = files.there_of(entries, files.listed(entries))
    found, doubtful = dict[Slot, SlotState](), list[tuple[Slot, str]]()
    columns = (entries.table[name].to_pylist() for name in ("sha256", "stamp"))
    rows = zip(entries.slots, of.tolist(), there.tolist(), files.stamps(entries), *columns, strict=True)
    for slot, case, here, stamp, sha256, seen in rows:
        state = found[slot] = _state(cases[case], here)
        if state.accepted and state.todo not in (OPEN, PHYSICS) and (not seen or stamp != seen):
            doubtful.append((slot, sha256))
    asked = set(wanted) if doubtful else ()
    doubtful = [(slot, sha256) for slot, sha256 in doubtful if slot in asked]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
        whole = threads.map(lambda pair: dataset.hashed(*pair), doubtful)
        for (slot, _), same in zip(doubtful, whole, strict=True):
            found[slot] = replace(found[slot], restamp=True) if same else SlotState(PHYSICS, (REDO,), True)
    for slot in _lacking(dataset, entries) if recipe.keep_failures != "none" else ():
        if found[slot].todo != OPEN:
            found[slot] = SlotState(PHYSICS, (GONE,), found[slot].accepted)
    none = SlotState(OPEN)
    for slot in wanted:
        yield slot, found.get(slot, none)


def _lacking(dataset: Dataset, entries: Entries) -> Iterator[Slot]:
    """Slots of which a failed attempt that is kept is missing."""
    column = single(entries.table["attempts"])
    attempts, rows = column.flatten(), parents(column)
    of, names = codes(attempts.field("kept"))
    tried = numbers(attempts.field("attempt"))
    for each in np.flatnonzero(np.array([bool(name) for name in (*names, "")])[of]).tolist():
        slot = entries.slots[rows[each]]
        if not dataset.failure(slot, int(tried[each])).exists():
            yield slot

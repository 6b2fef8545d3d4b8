"""What of a slot is done, and what a build would do again and why."""

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.data.columns import codes
from pipeline.data.dataset import Dataset
from pipeline.data.entries import Entries, Files
from pipeline.data.ledger import NO_RECORD
from pipeline.data.ledger_table import unpack_keys
from pipeline.data.recipe import Recipe, Slot
from pipeline.data.stamps import stamp_of
from pipeline.registry import UnknownName
from pipeline.run.keys import RecipeKeys

REDO = "episode missing or damaged"
"""Why a slot is made again whose keys match."""

DONE, OPEN, PHYSICS, IMAGES, SENTENCES = "done", "open", "physics", "images", "sentences"


@dataclass(frozen=True)
class SlotState:
    """`todo` is DONE, OPEN (nothing is there), or what must be made again: PHYSICS (everything), IMAGES (from the stored state
    log) or SENTENCES; `because` names the parts of the key that changed. `accepted` is what the ledger entry says, None where there
    is none; `restamp` that its episode had to be read to see that it is whole: its entry has another stamp."""

    todo: str
    because: tuple[str, ...] = ()
    accepted: bool | None = None
    restamp: bool = False


def entry_states(dataset: Dataset, recipe: Recipe, entries: Entries) -> Iterator[tuple[Slot, SlotState]]:
    """Every entry's slot with its state against the keys it would have now, episodes unread. `keys` must have been read.

    What was made for a task or robot that the code does not have is out of date. A slot that was given up has images and sentences
    only where the recipe keeps failed attempts. Entries of a cell mostly have the same keys, so few are compared.
    """
    files, seen = Files(dataset.episodes), dict[tuple[object, ...], SlotState | None]()
    keys = RecipeKeys(recipe)
    texts = entries.table["keys"].to_pylist()
    for slot, accepted, text in zip(entries.slots, entries.accepted, texts, strict=True):
        case = (slot.cell, slot.variant, accepted, text)
        if case not in seen:
            seen[case] = _against(keys, slot, accepted, text, recipe.keep_failures != "none")
        state = seen[case]
        if state is None:
            yield slot, SlotState(OPEN)
        elif accepted and state.todo != PHYSICS and not files.there(slot):
            yield slot, SlotState(OPEN, (REDO,), accepted)
        else:
            yield slot, state


def redone(recipe: Recipe, entries: Entries, there: NDArray[np.bool_]) -> Counter[tuple[str, tuple[str, ...]]]:
    """How many slots, of those that `entries` holds, a build would make again, by what of them and why: as `entry_states` says one
    by one. `keys` must have been read; `there` (N,) says whose episode is there."""
    keys, found = RecipeKeys(recipe), Counter[tuple[str, tuple[str, ...]]]()
    accepted = np.array(entries.accepted, bool)
    variants = np.array(entries.numbers[1], np.int64)
    numbered, texts = codes(entries.table["keys"])
    cases = ((entries.ranks * (recipe.variants + 1) + variants) * 2 + accepted) * (len(texts) + 1) + numbered
    _, firsts, rows = np.unique(cases, return_index=True, return_inverse=True)
    whole = np.bincount(rows, weights=there | ~accepted, minlength=len(firsts)).astype(int).tolist()
    every = np.bincount(rows, minlength=len(firsts)).tolist()
    for case, first in enumerate(firsts.tolist()):
        slot = Slot(entries.cells[entries.ranks[first]], entries.numbers[0][first], entries.numbers[1][first])
        text = texts[numbered[first]] if numbered[first] >= 0 else ""
        state = _against(keys, slot, bool(accepted[first]), text, recipe.keep_failures != "none")
        if state is not None and state.todo not in (DONE, OPEN):
            number = every[case] if state.todo == PHYSICS else whole[case]
            found[state.todo, state.because] += number
    return +found


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
    found, none = dict(entry_states(dataset, recipe, dataset.entries(recipe, ("keys",)))), SlotState(OPEN)
    for slot in recipe.slots():
        yield slot, found.get(slot, none)


def read_states(dataset: Dataset, recipe: Recipe, slots: Iterable[Slot]) -> Iterator[tuple[Slot, SlotState]]:
    """Slots of a recipe, in order, with their states after a look at every episode: one whose bytes are not the ledger's is made
    again from nothing.

    A file with the stamp of its entry (length and time of its last change) has not been written since; every other one is read, on
    as many threads as there are cores.
    """
    entries, wanted = dataset.entries(recipe, ("keys", "stamp", "attempts")), list(slots)
    found = dict(entry_states(dataset, recipe, entries))
    files, doubtful = Files(dataset.episodes), list[tuple[Slot, str]]()
    asked = set(wanted)
    columns = (entries.table[name].to_pylist() for name in ("sha256", "stamp"))
    for slot, sha256, stamp in zip(entries.slots, *columns, strict=True):
        state = found[slot]
        if slot in asked and state.accepted and state.todo not in (OPEN, PHYSICS):
            entry = files.entry(slot)
            if not stamp or entry is None or stamp_of(entry.stat()) != stamp:
                doubtful.append((slot, sha256))
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
        whole = threads.map(lambda pair: dataset.hashed(*pair), doubtful)
        for (slot, _), same in zip(doubtful, whole, strict=True):
            found[slot] = replace(found[slot], restamp=True) if same else SlotState(PHYSICS, (REDO,), True)
    none = SlotState(OPEN)
    for slot in wanted:
        yield slot, found.get(slot, none)

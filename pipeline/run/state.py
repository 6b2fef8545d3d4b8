"""What of a slot is done, and what a build would do again and why."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from pipeline.data.dataset import Dataset
from pipeline.data.keys import SlotKeys
from pipeline.data.ledger import SlotRecord
from pipeline.data.recipe import Recipe, Slot
from pipeline.registry import UnknownName
from pipeline.run.keys import slot_keys

REDO = "episode missing or damaged"
"""Why a slot is made again whose keys match."""

DONE, OPEN, PHYSICS, IMAGES, SENTENCES = "done", "open", "physics", "images", "sentences"


@dataclass(frozen=True)
class SlotState:
    """`todo` is DONE, OPEN (nothing is there), or what must be made again: PHYSICS (everything), IMAGES (from the stored state
    log) or SENTENCES; `because` names the parts of the key that changed. `record` is the ledger entry, where there is one."""

    todo: str
    because: tuple[str, ...] = ()
    record: SlotRecord | None = None


def slot_state(dataset: Dataset, slot: Slot, keys: SlotKeys) -> SlotState:
    """State of a slot against the keys it would have now. A slot that was given up has no images and no sentences."""
    record = dataset.record(slot)
    if record is None:
        return SlotState(OPEN)
    if changed := record.keys.physics.changed(keys.physics):
        return SlotState(PHYSICS, tuple(changed), record)
    if not record.accepted:
        return SlotState(DONE, (), record)
    if not dataset.episode(slot).exists():
        return SlotState(OPEN, (REDO,), record)
    images = tuple(record.keys.render.changed(keys.render))
    sentences = tuple(record.keys.language.changed(keys.language))
    if images:
        return SlotState(IMAGES, images + sentences, record)
    return SlotState(SENTENCES, sentences, record) if sentences else SlotState(DONE, (), record)


def read_state(dataset: Dataset, slot: Slot, keys: SlotKeys) -> SlotState:
    """As `slot_state`, after reading the episode: one whose bytes are not the ledger's is made again from nothing."""
    state = slot_state(dataset, slot, keys)
    record = state.record
    if record is None or not record.accepted or state.todo in (OPEN, PHYSICS):
        return state
    if not dataset.intact(slot, record):
        return SlotState(PHYSICS, (REDO,), record)
    return state


def states(dataset: Dataset, recipe: Recipe) -> Iterator[tuple[Slot, SlotState]]:
    """Every slot of a recipe with its state now, episodes unread: whether their bytes are the ledger's is for `read_states`.

    What was made for a task or robot that the code does not have is out of date.
    """
    for slot in recipe.slots():
        yield slot, _state(dataset, recipe, slot, slot_state)


def read_states(dataset: Dataset, recipe: Recipe, slots: Iterable[Slot]) -> Iterator[tuple[Slot, SlotState]]:
    """Slots of a recipe, in order, with their states after reading every episode, on as many threads as there are cores."""
    wanted = list(slots)
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
        yield from zip(wanted, threads.map(lambda slot: _state(dataset, recipe, slot, read_state), wanted), strict=True)


def _state(dataset: Dataset, recipe: Recipe, slot: Slot, look: Callable[[Dataset, Slot, SlotKeys], SlotState]) -> SlotState:
    try:
        return look(dataset, slot, slot_keys(recipe, slot))
    except UnknownName as unknown:
        record = dataset.record(slot)
        return SlotState(OPEN if record is None else PHYSICS, (str(unknown),), record)

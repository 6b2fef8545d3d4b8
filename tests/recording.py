"""Slots of a dataset as they are once a build has made them, without a build."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.keys import SlotKeys, file_hash
from pipeline.data.recipe.model import Slot
from pipeline.data.slots.files import write_given_up
from pipeline.data.slots.records import FileFacts, SlotRecord
from pipeline.data.slots.reread import IndexWriter


def record_all(dataset: Dataset, entries: Iterable[tuple[Slot, SlotRecord]]) -> None:
    """Write records into the index of a dataset."""
    with IndexWriter(dataset, dataset.recipe()) as writer:
        for slot, record in entries:
            writer.add(slot, record)


type Attempts = Sequence[Mapping[str, Any]]


def record_file(
    dataset: Dataset, slot: Slot, keys: SlotKeys, attempts: Attempts = (), **facts: Any
) -> SlotRecord:
    """Record a slot by the episode that is there, or that it was given up. `facts` replaces what is
    known of the file."""
    rows = tuple(map(dict, attempts))
    path = dataset.episode(slot)
    if path.exists():
        record = SlotRecord(
            keys,
            True,
            file_hash(path),
            rows,
            1.0,
            0.0,
            replace(FileFacts.of(path.stat(), 3), **facts),
        )
    else:
        record = write_given_up(dataset, slot, keys, rows)
    record_all(dataset, [(slot, record)])
    return record


def finish(
    dataset: Dataset,
    slot: Slot,
    keys: SlotKeys,
    attempts: Sequence[Mapping[str, Any]],
    data: bytes = b"episode",
) -> SlotRecord:
    """A slot whose last attempt says whether it was accepted, with a file of some bytes where its
    episode belongs."""
    if attempts[-1]["outcome"] == "accepted":
        write_atomic(dataset.episode(slot), data)
    return record_file(dataset, slot, keys, attempts)

"""The note in place of an episode that a slot was given up: its keys and its attempts, so that
nothing but files is needed."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.data.atomic import write_atomic
from pipeline.data.keys import SlotKeys, canonical, file_hash
from pipeline.data.parsing import parse_json
from pipeline.data.paths import Paths
from pipeline.data.reading import read_regular
from pipeline.data.recipe.cells import Slot
from pipeline.data.records import FileFacts, SlotRecord, untimed
from pipeline.data.store.place import delete, place_of, put


def write_given_up(
    dataset: Paths, slot: Slot, keys: SlotKeys, attempts: Sequence[Mapping[str, Any]]
) -> SlotRecord:
    """Note that a slot was given up; its record. Raises OSError."""
    path = dataset.file(slot, False)
    values = {"slot": slot.path, "keys": keys.to_json(), "attempts": untimed(attempts)}
    write_atomic(path, json.dumps(values, sort_keys=True, indent=1).encode() + b"\n")
    record = SlotRecord(
        keys, False, file_hash(path), tuple(map(dict, attempts)), file=FileFacts.of(path.stat())
    )
    put(path)
    return record


def read_given_up(path: Path, slot: str) -> tuple[SlotKeys, list[dict[str, Any]]]:
    """The keys and the attempts of the note on the slot with this path.

    Raises OSError, ValueError, KeyError, TypeError or AttributeError for a file that is none.
    """
    values = parse_json(read_regular(path))
    canonical(values)  # refuses texts that have no UTF-8
    attempts = [dict(row) for row in values["attempts"]]
    if values["slot"] != slot or any(row["outcome"] == "accepted" for row in attempts):
        raise ValueError("is not the note that this slot was given up")
    return SlotKeys.from_json(values["keys"]), attempts


def remove_given_up(dataset: Paths, slot: Slot) -> None:
    """Remove the note on a slot, which has an episode now. Raises OSError."""
    path = dataset.file(slot, False)
    if path.exists() or place_of(path):
        path.unlink(missing_ok=True)
        delete(path)

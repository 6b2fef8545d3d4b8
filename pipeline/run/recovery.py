"""Restores missing ledger entries from the attributes of the episode files and from attempts.parquet."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.keys import SlotKeys, file_hash
from pipeline.data.ledger.columns import distinct
from pipeline.data.ledger.entries import Files
from pipeline.data.ledger.files import DamagedLedger, records_of
from pipeline.data.ledger.records import ATTEMPTS, NO_RECORD, SlotRecord
from pipeline.data.ledger.table import PLACE, place_of
from pipeline.data.reading import check_regular
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.store.mirror import free_space
from pipeline.run.slot.make import facts

type Rows = Mapping[tuple[Any, ...], Sequence[dict[str, Any]]]
"""Attempts by the columns that name their slot."""


def recover(dataset: Dataset, recipe: Recipe) -> int:
    """Write an entry for every episode that is whole and has none: its file of the ledger was damaged or lost. Returns how many.

    An episode is whole where its datasets have the hashes that it holds, its spec is that of the accepted attempt in
    attempts.parquet, and it says all parts of its keys. Any other one is made again. Seconds by phase are
    lost. Raises OSError if the disk refuses.
    """
    _name_once(dataset, recipe)
    known, files = dataset.entries(recipe, ("stamp",)), Files(dataset.episodes)
    recorded = set(known.slots)
    orphans = [slot for slot in recipe.slots() if slot not in recorded and files.there(slot)]
    rows = _attempts(dataset) if orphans else {}
    if not rows:
        return 0
    hashes = dict(zip(known.slots, known.table["sha256"].to_pylist(), strict=True))
    found = list(_recover(dataset, recipe, orphans, rows, hashes))
    if found:
        dataset.ledger.add(found)
        dataset.ledger.compact()
    return len(found)


def _name_once(dataset: Dataset, recipe: Recipe) -> None:
    """Have every slot named once by its file of the ledger; the first of its entries stays."""
    twice = list[tuple[Slot, SlotRecord]]()
    for group in product(recipe.tasks, recipe.embodiments):
        try:
            places = dataset.ledger.read_rows(group, PLACE)
        except DamagedLedger:
            continue
        if len(distinct(places)) < len(places):
            first = dict[Slot, SlotRecord]()
            for slot, record in records_of(dataset.ledger.table(group)):
                if slot in first:
                    twice.append((slot, first[slot]))
                first.setdefault(slot, record)
    if twice:
        dataset.ledger.add(twice)
        dataset.ledger.compact()


def _recover(
    dataset: Dataset, recipe: Recipe, orphans: Sequence[Slot], rows: Rows, hashes: dict[Slot, str]
) -> Iterator[tuple[Slot, SlotRecord]]:
    """Entries of those orphans that are whole; variants follow the slot whose physics they show."""
    for slot in orphans:
        tried = rows.get(place_of(slot.physical)[:-1], ())
        try:
            record = _record(dataset, recipe, slot, tried, hashes.get(slot.physical, "") if slot.variant else "")
        except PermissionError:
            raise
        except (EpisodeError, OSError, *NO_RECORD):
            continue  # made again
        finally:
            free_space(dataset.episode(slot))
        hashes[slot] = record.sha256
        yield slot, record


def _record(dataset: Dataset, recipe: Recipe, slot: Slot, tried: Sequence[dict[str, Any]], source: str) -> SlotRecord:
    """The entry of an episode. Raises EpisodeError, OSError or ValueError if it is not whole or not that of the slot."""
    path = dataset.episode(slot)
    sha = file_hash(path)
    with EpisodeFile(path) as file:
        meta, wanted = file.meta, recipe.spec(slot.physical, tried[-1]["attempt"] if tried else 0)
        keys = SlotKeys.from_json(meta.keys)
        said = (meta.physics_key, meta.render_key, meta.variant, meta.failure)
        if said != (keys.physics.digest, keys.render.digest, slot.variant, None) or file.spec != wanted or file.damaged():
            raise ValueError("is not whole, or not the episode of this slot")
        seen = facts(dataset, path, len(file), meta.drawing)
    # a build reads the assets that no entry has seen whole: these were not
    seen = replace(seen, assets=dict.fromkeys(seen.assets, ""))
    record = SlotRecord(keys, True, sha, () if slot.variant else tuple(tried), {}, source, seen)
    record.check()
    if not tried or tried[-1]["outcome"] != "accepted":
        raise ValueError("its attempts are not known")
    return record


def _attempts(dataset: Dataset) -> Rows:
    """What attempts.parquet says; nothing if it is missing or damaged."""
    try:
        check_regular(dataset.attempts)
        table = pq.read_table(dataset.attempts, schema=ATTEMPTS).to_pylist()
    except (OSError, ValueError, TypeError, pa.ArrowException):
        return {}
    rows = defaultdict[tuple[Any, ...], list[dict[str, Any]]](list)
    for row in sorted(table, key=lambda row: row["attempt"] or 0):
        place = tuple(row[name] for name in PLACE[:-1])
        rows[place].append({name: value for name, value in row.items() if value is not None})
    return rows

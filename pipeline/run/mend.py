"""What a dataset has lost, put back before work begins: entries of its ledger, from its episodes, and assets, without physics."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.data.assets import AssetError, AssetStore
from pipeline.data.atomic import remove
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.keys import SlotKeys, file_hash
from pipeline.data.ledger.columns import distinct
from pipeline.data.ledger.entries import Files
from pipeline.data.ledger.files import DamagedLedger, records_of
from pipeline.data.ledger.records import ATTEMPTS, NO_RECORD, SlotRecord
from pipeline.data.ledger.stamps import file_stamp
from pipeline.data.ledger.table import PLACE, place_of
from pipeline.data.reading import check_regular
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.store.mirror import free_space
from pipeline.motion.models import motion_from_json
from pipeline.run.slot.make import facts
from pipeline.stages.drawing.render import appearance_of, keep
from pipeline.stages.scene import build_scene

_DIGITS = 32

type Restore = Callable[[Slot, set[str]], None]
"""Puts assets (by hash) that an episode names into the store again, as far as it can."""


def mend_assets(dataset: Dataset, recipe: Recipe, slots: Collection[Slot], restore: Restore) -> set[Slot]:
    """Remove damaged assets, and restore missing ones that the episodes of `slots` name.

    Reads only the assets whose present stamp is in no ledger entry. Returns the slots of which an asset is still missing: what they
    were drawn from is lost. Raises OSError if a file cannot be read or written.
    """
    store, entries = AssetStore(dataset.bodies), dataset.entries(recipe, ("assets", "asset_stamps"))
    named, stamps = entries.table["assets"], entries.table["asset_stamps"]
    pairs = distinct(pa.table({"key": named.combine_chunks().flatten(), "stamp": stamps.combine_chunks().flatten()}))
    there = _whole(store, set(zip(pairs["key"].to_pylist(), pairs["stamp"].to_pylist(), strict=True)))
    absent = set(named.combine_chunks().flatten().unique().to_pylist()) - there
    lacking: dict[Slot, set[str]] = {}
    for number, slot in enumerate(entries.slots) if absent else ():
        if slot not in slots:
            continue
        missing = set(named[number].as_py()) - there
        if missing:
            restore(slot, missing)
            there |= {key for key in missing if store.path(key).exists()}
            lacking[slot] = missing
    return {slot for slot, missing in lacking.items() if missing - there}


def _whole(store: AssetStore, seen: Collection[tuple[str, str]]) -> set[str]:
    """The assets that are there; those without a stamp that was seen are read, and removed where they are damaged."""
    there = set[str]()
    for path in sorted(store.root.glob("??/*.npz")):
        key = path.stem
        if len(key) != _DIGITS or not key.startswith(path.parent.name):
            continue
        if (key, file_stamp(path)) not in seen:
            try:
                store.renew(key)
            except AssetError:
                remove(path)
                continue
        there.add(key)
    return there


def from_scenes(dataset: Dataset, recipe: Recipe) -> Restore:
    """Restores the assets of an episode from its scene, built again."""

    def restore(slot: Slot, missing: set[str]) -> None:
        with EpisodeFile(dataset.episode(slot)) as file:
            scene = build_scene(file.spec, recipe.ruling()).furnished(motion_from_json(file.array("motion").item().decode()))
        keep(appearance_of(scene, recipe), AssetStore(dataset.bodies))

    return restore


def from_source(dataset: Dataset, source: Dataset) -> Restore:
    """Restores assets from the dataset that the episodes were drawn from."""

    def restore(slot: Slot, missing: set[str]) -> None:
        for key in missing:
            try:
                AssetStore(dataset.bodies).copy(key, AssetStore(source.bodies))
            except AssetError:
                continue

    return restore


type Rows = Mapping[tuple[Any, ...], Sequence[dict[str, Any]]]  # attempts by the columns that name their slot


def recover(dataset: Dataset, recipe: Recipe) -> int:
    """Write an entry for every episode that is whole and has none: its file of the ledger was damaged or lost. Returns how many.

    An episode is whole where its datasets have the hashes that it holds, its spec is that of the accepted attempt in
    attempts.parquet, and it has all parts of its keys. Any other one is made again. Raises OSError. Seconds by phase are lost.
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

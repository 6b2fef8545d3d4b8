"""Assets of a dataset that are missing or damaged, put back before work begins: nothing is drawn and no physics is run for them."""

from collections.abc import Callable, Collection

import pyarrow as pa

from pipeline.data.assets import AssetError, AssetStore
from pipeline.data.atomic import remove
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.ledger.columns import distinct
from pipeline.data.ledger.stamps import file_stamp
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.motion.models import motion_from_json
from pipeline.stages.render import appearance_of, keep
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

"""Assets of a dataset that are missing or damaged, put back before work begins: nothing is drawn and no physics is run for them."""

from collections.abc import Callable, Iterable

from pipeline.data.assets import AssetError, AssetStore
from pipeline.data.dataset import Dataset
from pipeline.data.episode import EpisodeError, EpisodeFile
from pipeline.data.recipe import Recipe, Slot
from pipeline.run.make import wanted_appearance
from pipeline.stages.render import keep
from pipeline.stages.scene import build_scene

type Restore = Callable[[Slot, set[str]], None]
"""Puts assets (by hash) that an episode names into the store again, as far as it can."""


def mend_assets(dataset: Dataset, slots: Iterable[Slot], restore: Restore) -> set[Slot]:
    """Remove damaged assets and restore those that the episodes of `slots` name and the store lacks.

    Returns the slots of which an asset is still missing: what they were drawn from is not known any more. Raises OSError where the
    disk refuses.
    """
    store = AssetStore(dataset.bodies)
    store.sweep()
    there = {path.stem for path in dataset.bodies.glob("*/*.npz")}
    lacking: dict[Slot, set[str]] = {}
    for slot in slots:
        try:
            with EpisodeFile(dataset.episode(slot)) as file:
                missing = set(file.meta.drawing.assets.values()) - there
        except EpisodeError:
            continue  # of another version of the schema: made again because of its keys
        if missing:
            restore(slot, missing)
            there |= {key for key in missing if store.path(key).exists()}
            lacking[slot] = missing
    return {slot for slot, missing in lacking.items() if missing - there}


def from_scenes(dataset: Dataset, recipe: Recipe) -> Restore:
    """Restores the assets of an episode from its scene, built again."""

    def restore(slot: Slot, missing: set[str]) -> None:
        with EpisodeFile(dataset.episode(slot)) as file:
            scene = build_scene(file.spec, recipe.ruling())
        keep(wanted_appearance(dataset, scene, recipe), AssetStore(dataset.bodies))

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

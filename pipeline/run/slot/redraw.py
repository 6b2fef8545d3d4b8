"""One slot drawn again from stored state; no physics is run."""

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.meta import CameraInfo
from pipeline.data.episode.state_log import physics_id
from pipeline.data.errors import DominoError
from pipeline.data.intact import CHANGED
from pipeline.data.keys import SlotKeys, is_intact
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.files import write_given_up
from pipeline.data.slots.records import FileFacts, SlotRecord, untimed
from pipeline.run.identity.slot_keys import RecipeKeys
from pipeline.stages.drawing.render import (
    SURFACE,
    keep_images,
    sensing_of,
    stored_appearance,
    surface_images,
    visuals_of,
    with_setup,
)
from pipeline.world.looks.materials import load_parts
from pipeline.world.shapes import Parts

from .make import images_of, send_slot, write


@dataclass(frozen=True)
class DrawJob:
    """A slot to draw from the episode `origin`. `same_look`: whether its stored look is the
    wanted one.
    """

    source: str
    out: str
    recipe: Recipe
    slot: Slot
    origin: Slot
    record: SlotRecord
    same_look: bool


def origin_of(source: Recipe, recipe: Recipe, slot: Slot) -> tuple[Slot, bool]:
    """The source slot to draw from, and whether its stored look is wanted; other looks start
    from variant 0.
    """
    same = (source.visuals, *source.brought) == (recipe.visuals, *recipe.brought) and (
        recipe.visuals != "randomized" or source.visual_seed == recipe.visual_seed
    )
    if same and slot.variant < source.variants:
        return slot, True
    return slot.physical, False


def is_drawn(
    record: SlotRecord | None, source: SlotRecord, keys: SlotKeys, assets: Collection[str]
) -> bool:
    """Whether a slot is drawn from that source with these keys."""
    if record is None or record.keys != keys or record.accepted != source.accepted:
        return False
    # an episode of version 0.1 may name no physics
    same = source.file.physics_id in ("", record.file.physics_id)
    return same and all(key in assets for key in record.file.assets)


def draw_slot(job: DrawJob) -> SlotRecord | str:
    """Draw one slot again, or give it up as in the source. Returns the record, or why not.
    Raises OSError.
    """
    source, out = Dataset(Path(job.source)), Dataset(Path(job.out))
    began, worked = time.perf_counter(), time.process_time()
    keys = RecipeKeys(job.recipe).redrawn(job.slot, job.record.keys)
    # failed attempts stay with the dataset that made them
    attempts = tuple(
        {k: v for k, v in row.items() if k != "kept"}
        for row in (() if job.slot.variant else job.record.attempts)
    )
    if not job.record.accepted:
        return write_given_up(out, job.slot, keys, attempts)
    try:
        sha, facts = _draw(source, out, job, attempts, keys)
    except DominoError as error:
        return str(error)
    spent = time.perf_counter() - began, time.process_time() - worked
    record = SlotRecord(keys, True, sha, attempts, *spent, facts)
    send_slot(out, job.slot, record)
    return record


def _draw(
    source: Dataset,
    out: Dataset,
    job: DrawJob,
    attempts: Sequence[Mapping[str, Any]],
    keys: SlotKeys,
) -> tuple[str, FileFacts]:
    path, recipe, variant = source.episode(job.origin), job.recipe, job.slot.variant
    store, own = AssetStore(source.bodies), AssetStore(out.bodies)
    if not is_intact(path, job.record.sha256):
        raise EpisodeError(f"{path}: {CHANGED}")
    with EpisodeFile(path) as file:
        episode = file.read()
    stored = stored_appearance(episode, store, cached_parts)
    spec, log, meta = episode.spec, episode.log, episode.meta
    look = stored.visuals if job.same_look else visuals_of(spec, recipe, variant)
    sensing = sensing_of(spec, recipe.sensors, meta.fps, variant)
    appearance = with_setup(stored, recipe, look, log.sides, sensing)
    if not job.same_look:
        appearance = replace(appearance, images=surface_images(look, recipe))
    assets = meta.drawing.assets.items()
    kept = {name: key for name, key in assets if not name.startswith(SURFACE)}
    changed = {
        "preset": appearance.preset,
        "visuals": look,
        "cameras": {camera.name: CameraInfo.of(camera) for camera in appearance.cameras},
        "sensors": recipe.sensors,
        "assets": kept | keep_images(appearance.images, own),
    }
    drawing = meta.drawing.model_copy(update=changed)
    objects = [name for name in meta.objects if name not in meta.clutter]
    images = images_of(appearance, drawing, objects, log, recipe)
    for key in dict.fromkeys(kept.values()):
        own.copy(key, store)
    known = {"physics_id": physics_id(spec, log), "variant": variant, "drawing": images.drawing}
    meta = meta.model_copy(update=known | keys.header())
    redrawn = replace(episode, meta=meta, attempts=untimed(attempts))
    return write(out.episode(job.slot), redrawn, images)


# the links of five robots and some objects, about 0.1 MB each
@lru_cache(maxsize=256)
def _load_parts(bodies: Path, key: str) -> Parts:
    return load_parts(AssetStore(bodies), key)


def cached_parts(store: AssetStore, key: str) -> Parts:
    """The parts of an asset, kept by this process: bodies share robot links."""
    return _load_parts(store.root, key)

"""One slot drawn again from a stored episode's state log and assets. No physics is run."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.meta import CameraInfo
from pipeline.data.episode.state_log import physics_id
from pipeline.data.errors import DominoError
from pipeline.data.intact import CHANGED, is_intact
from pipeline.data.keys import SlotKeys
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.files import write_given_up
from pipeline.data.slots.records import FileFacts, SlotRecord, untimed
from pipeline.run.identity.slot_keys import code_version, redrawn_keys
from pipeline.run.slot.make import images_of, read_facts, send_slot, write
from pipeline.stages.attempt import Phases
from pipeline.stages.drawing.render import (
    SURFACE,
    keep_images,
    sensing_of,
    stored_appearance,
    visuals_of,
    with_setup,
)
from pipeline.stages.drawing.render import images_of as surfaces_of
from pipeline.world.looks.materials import load_parts
from pipeline.world.shapes import Parts

# assets that a worker keeps loaded: the links of five robots and some objects, about 0.1 MB each
KEPT_PARTS = 256


@dataclass(frozen=True)
class DrawJob:
    """One episode to draw: `slot` of the dataset `out`, from the episode `origin` of `source` with
    `record`. `same_look`: whether its stored look is the wanted one; `code`: the driver's
    version."""

    source: str
    out: str
    recipe: Recipe
    slot: Slot
    origin: Slot
    record: SlotRecord
    same_look: bool
    code: str


def origin_of(source: Recipe, recipe: Recipe, slot: Slot) -> tuple[Slot, bool]:
    """The slot of the `source` that a slot of `recipe` is drawn from, and whether its stored look
    is the wanted one. Looks that it does not store are drawn for variant 0."""
    same = (source.visuals, *source.brought) == (recipe.visuals, *recipe.brought) and (
        recipe.visuals != "randomized" or source.visual_seed == recipe.visual_seed
    )
    if same and slot.variant < source.variants:
        return slot, True
    return slot.physical, False


def is_drawn(
    record: SlotRecord | None, source: SlotRecord, keys: SlotKeys, assets: Collection[str]
) -> bool:
    """Whether a slot with this record is drawn from just that source with these keys, no asset
    missing."""
    if record is None or record.keys != keys or record.accepted != source.accepted:
        return False
    # an episode of version 0.1 may name no physics
    same = source.file.physics_id in ("", record.file.physics_id)
    return same and all(key in assets for key in record.file.assets)


def draw_slot(job: DrawJob) -> SlotRecord | str:
    """Draw one slot and write its episode; one that was given up in the source is given up here.

    Returns the record, or in one line why the source cannot be drawn from. Raises DatasetError on a
    worker of other code, OSError."""
    if job.code != code_version():
        raise DatasetError(
            f"a worker runs code {code_version()}, the driver {job.code}: install the same version"
            " everywhere"
        )
    source, out, phases = Dataset(Path(job.source)), Dataset(Path(job.out)), Phases()
    keys = redrawn_keys(job.recipe, job.slot, job.record.keys)
    # failed attempts stay with the dataset that made them
    attempts = (
        ()
        if job.slot.variant
        else tuple({k: v for k, v in row.items() if k != "kept"} for row in job.record.attempts)
    )
    if not job.record.accepted:
        return write_given_up(out, job.slot, keys, attempts)
    try:
        sha, known = _draw(source, out, job, attempts, keys, phases)
    except DominoError as error:
        return str(error)
    record = SlotRecord(keys, True, sha, attempts, phases.record(), known)
    send_slot(out, job.slot, record)
    return record


def _draw(
    source: Dataset,
    out: Dataset,
    job: DrawJob,
    attempts: Sequence[Mapping[str, Any]],
    keys: SlotKeys,
    phases: Phases,
) -> tuple[str, FileFacts]:
    """Write the episode; its sha256, and what is known of it."""
    path, store = source.episode(job.origin), AssetStore(source.bodies)
    with phases("read"):
        if not is_intact(path, job.record.sha256):
            raise EpisodeError(f"{path}: {CHANGED}")
        with EpisodeFile(path) as file:
            episode = file.read()
        stored = stored_appearance(episode, store, cached_parts)
    look = stored.visuals
    if not job.same_look:
        look = visuals_of(episode.spec, job.recipe, job.slot.variant)
    sensing = sensing_of(episode.spec, job.recipe.sensors, episode.meta.fps, job.slot.variant)
    appearance = with_setup(stored, job.recipe, look, episode.log.sides, sensing)
    if not job.same_look:
        appearance = replace(appearance, images=surfaces_of(look, job.recipe))
    kept = {
        name: key
        for name, key in episode.meta.drawing.assets.items()
        if not name.startswith(SURFACE)
    }
    cameras = {camera.name: CameraInfo.of(camera) for camera in appearance.cameras}
    changed = {
        "preset": appearance.preset,
        "visuals": look,
        "cameras": cameras,
        "sensors": job.recipe.sensors,
    }
    changed["assets"] = kept | keep_images(appearance.images, AssetStore(out.bodies))
    drawing = episode.meta.drawing.model_copy(update=changed)
    objects = [name for name in episode.meta.objects if name not in episode.meta.clutter]
    images = images_of(appearance, drawing, objects, episode.log, job.recipe, phases)
    with phases("write"):
        for key in dict.fromkeys(kept.values()):
            AssetStore(out.bodies).copy(key, store)
    known = {
        "physics_id": physics_id(episode.spec, episode.log),
        "variant": job.slot.variant,
        "drawing": images.drawing,
    }
    redrawn = replace(
        episode,
        meta=episode.meta.model_copy(update=known | keys.header()),
        attempts=untimed(attempts),
    )
    sha = write(out.episode(job.slot), redrawn, images, phases)
    return sha, read_facts(out, job.slot)


@lru_cache(maxsize=KEPT_PARTS)
def _load_parts(bodies: Path, key: str) -> Parts:
    return load_parts(AssetStore(bodies), key)


def cached_parts(store: AssetStore, key: str) -> Parts:
    """The parts of an asset, kept by this process: most bodies are the links of a robot."""
    return _load_parts(store.root, key)

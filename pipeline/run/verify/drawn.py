"""Whether stored images are what the state log shows: some frames of an episode are rendered again and compared byte by byte."""

from collections.abc import Iterator

import numpy as np

from pipeline.data.assets import AssetStore
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.jpeg import encode_frames
from pipeline.data.keys import Key
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.run.identity.slot_keys import redrawn_keys
from pipeline.run.slot.make import stored_images
from pipeline.run.slot.redraw import cached_parts
from pipeline.run.verify.tally import Finding, observe
from pipeline.stages.render import capture, stored_appearance


def other_device(dataset: Dataset, device: str) -> str:
    """Why nothing can be compared that `device` renders; empty if the dataset was rendered by the same kind of device.

    Two devices do not give the same pixels, and the keys of an episode do not name its device: provenance.json does.
    """
    try:
        made = dataset.made_by()
    except DatasetError:
        made = {}
    merged = made.get("merged_from", ())
    named = {str(each["renderer"]) for each in [made, *merged] if "renderer" in each} or {"an unknown device"}
    return "" if named == {device} else f"rendered by {', '.join(sorted(named))}, here by {device}"


def other_code(recipe: Recipe, slot: Slot, record: SlotRecord) -> str:
    """Why the images of an episode cannot be compared with what this version renders; empty if they can."""
    changed = record.keys.render.changed(redrawn_keys(recipe, slot, record.keys).render)
    return f"changed since: {', '.join(changed)}" if changed else ""


def check_drawn(dataset: Dataset, recipe: Recipe, slot: Slot, record: SlotRecord, count: int) -> Iterator[Finding]:
    """`count` frames of every camera, and the depth, segmentation and point clouds stored with them, rendered again.

    Which frames follows from the episode's keys. Raises EpisodeError and AssetError for files that cannot be read.
    """
    with EpisodeFile(dataset.episode(slot)) as file:
        episode, stored = file.read(), stored_images(file)
    frames = sample_frames(record.keys.render, len(episode.log), count)
    appearance = stored_appearance(episode, AssetStore(dataset.bodies), cached_parts)
    made = capture(appearance, episode.log, recipe, frames)
    for view, old, coded in zip(made.views, stored.views, stored.coded, strict=True):
        for k, (frame, image) in enumerate(zip(frames, encode_frames(view.rgb), strict=True)):
            pairs = ((view.depth, old.depth), (view.segmentation, old.segmentation))
            same = coded[frame] == image
            same &= all(b is not None and np.array_equal(a[k], b[frame]) for a, b in pairs if a is not None)
            yield observe("images", same, f"{view.camera.name} image {frame} is not what its state log shows")
    if made.pointcloud is not None:
        same = stored.pointcloud is not None and np.array_equal(made.pointcloud, stored.pointcloud[frames])
        yield observe("images", same, "pointcloud is not what its state log shows")


def sample_frames(key: Key, frames: int, count: int) -> list[int]:
    """Which frames of an episode are rendered again: `count` of them in order, or all where it has no more."""
    chosen = np.random.default_rng(int(key.digest, 16)).permutation(frames)[:count]
    return sorted(chosen.tolist())

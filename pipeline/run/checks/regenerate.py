"""One episode made again and compared byte by byte."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.hdf5 import differing
from pipeline.data.intact import named_slot
from pipeline.data.keys import file_hash
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.records import SlotRecord
from pipeline.data.store.place import is_there
from pipeline.run.names import installed_recipe
from pipeline.run.slot.fill import FillJob, LostAttempt, fill_slot
from pipeline.run.slot.redraw import DrawJob, draw_slot, origin_of
from pipeline.world.drawing.renderer import device_of


def regenerate(dataset: Dataset, episode: str) -> list[str]:
    """Make an episode again in a temporary directory. Returns the names of datasets that differ
    ("header" for attributes). Raises DatasetError, EpisodeError, NoRenderer. Its recipe's policy
    runs: see `check_trust`.
    """
    recipe = installed_recipe(dataset)
    slot = named_slot(dataset, recipe, episode)
    path = dataset.episode(slot)
    if not is_there(path):
        raise DatasetError(f"{path}: is not there: build it first")
    device_of(recipe.render)
    with TemporaryDirectory(prefix="domino-regenerate-") as folder:
        copy = Dataset(Path(folder) / "dataset")
        copy.create(recipe)
        record = dataset.record(recipe, slot.physical)
        made = _make(copy, recipe, slot, record.attempts if record else ())
        if made.sha256 == file_hash(path):
            return []
        if not copy.episode(slot).is_file():
            return ["no attempt was accepted"]
        try:
            with EpisodeFile(path) as a, EpisodeFile(copy.episode(slot)) as b:
                return differing(a.contents(), b.contents()) or ["the layout of the file"]
        except EpisodeError as error:
            return [str(error)]


def _make(
    copy: Dataset, recipe: Recipe, slot: Slot, attempts: Sequence[Mapping[str, Any]]
) -> SlotRecord:
    root = str(copy.root)
    lost = tuple(
        LostAttempt(row["attempt"], row["reason"], row.get("seconds", 0.0))
        for row in attempts
        if row.get("stage") == "worker"
    )
    physical = fill_slot(FillJob(root, recipe, slot.physical, lost=lost))
    if not slot.variant or not physical.accepted:
        return physical
    origin, same = origin_of(recipe.model_copy(update={"variants": 1}), recipe, slot)
    drawn = draw_slot(DrawJob(root, root, recipe, slot, origin, physical, same))
    if isinstance(drawn, str):
        raise DatasetError(f"{slot.path}: {drawn}")
    return drawn


def other_device(dataset: Dataset) -> str:
    """The device that drew a dataset, if not this one: pixels differ between devices."""
    try:
        made = dataset.made_by()
    except DatasetError:
        made = {}
    merged = [each for each in made.get("merged_from", ()) if isinstance(each, dict)]
    named = {str(each["renderer"]) for each in [made, *merged] if "renderer" in each}
    named = named or {"an unknown device"}
    here = device_of(dataset.recipe().render)
    return "" if named == {here} else f"drawn by {', '.join(sorted(named))}, here by {here}"


def is_image(name: str) -> bool:
    """Whether a dataset of an episode file is what a renderer drew."""
    return name == "pointcloud" or name.rpartition("/")[2] in ("rgb", "depth", "actor_segmentation")

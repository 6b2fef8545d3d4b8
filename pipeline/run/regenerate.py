"""`domino-data regenerate`: one episode made again from its recipe, elsewhere, and compared byte by byte with the stored one."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.hdf5 import open_hdf5
from pipeline.data.keys import file_hash
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.run.identity.slot_keys import code_version, slot_keys
from pipeline.run.names import installed_recipe
from pipeline.run.slot.fill import Lost, SlotJob, fill_slot
from pipeline.run.slot.redraw import DrawJob, draw_slot, origin_of
from pipeline.world.drawing.vulkan import ensure_renderer

_MOST = 12


@dataclass(frozen=True)
class Regenerated:
    """The comparison of a stored episode with the same episode made again.

    `stored` and `made` are the sha256 of both files, `differ` the arrays and attributes that differ, `changed` the parts of the
    keys that changed since the episode was made.
    """

    slot: str
    same: bool
    stored: str
    made: str
    differ: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()


def regenerate(dataset: Dataset, episode: str) -> Regenerated:
    """Make an episode again in a temporary directory, with all attempts at its slot, and compare. The dataset is left as it is.

    `episode` is the path of the file, from anywhere below `episodes/`. Raises DatasetError for one that is not in the dataset,
    NoRenderer without Vulkan.
    """
    recipe = installed_recipe(dataset)
    slot = find_slot(dataset, recipe, episode)
    record = dataset.record(slot)
    if record is None or not record.accepted or not dataset.episode(slot).is_file():
        raise DatasetError(f"{dataset.episode(slot)}: is not there, or has no ledger entry: build it first")
    ensure_renderer()
    keys = slot_keys(recipe, slot)
    changed = tuple(f"{kind}.{part}" for kind in vars(keys) for part in getattr(record.keys, kind).changed(getattr(keys, kind)))
    with TemporaryDirectory(prefix="domino-regenerate-") as folder:
        copy = Dataset(Path(folder) / "dataset")
        copy.create(recipe)
        made = _make(copy, recipe, slot, dataset.record(slot.physical) or record)
        stored = file_hash(dataset.episode(slot))
        differ = () if made.sha256 == stored else tuple(_differences(dataset.episode(slot), copy.episode(slot)))
    return Regenerated(slot.path, made.sha256 == stored, stored, made.sha256, differ, changed)


def find_slot(dataset: Dataset, recipe: Recipe, episode: str) -> Slot:
    """The slot of a path. Raises DatasetError for a path of none."""
    path = Path(episode).with_suffix("") if episode.endswith(".hdf5") else Path(episode)
    if path.is_absolute() and path.is_relative_to(dataset.episodes.resolve()):
        path = path.relative_to(dataset.episodes.resolve())
    name = path.as_posix().rpartition("episodes/")[2]
    for slot in recipe.slots():
        if slot.path == name:
            return slot
    first = next(recipe.slots()).path
    raise DatasetError(f"--episode {episode}: {dataset.root} has no such slot; write it as {first}")


def _make(copy: Dataset, recipe: Recipe, slot: Slot, record: SlotRecord) -> SlotRecord:
    """Fill the slot again, without any attempt that once killed two workers."""
    lost = tuple(Lost(row["attempt"], row["reason"], row["seconds"]) for row in record.attempts if row.get("stage") == "worker")
    physical = fill_slot(SlotJob(str(copy.root), recipe, slot.physical, code_version(), lost=lost))
    if not slot.variant or not physical.accepted:
        return physical
    origin, same = origin_of(recipe.model_copy(update={"variants": 1}), recipe, slot)
    drawn = draw_slot(DrawJob(str(copy.root), str(copy.root), recipe, slot, origin, physical, same, code_version()))
    if isinstance(drawn, str):
        raise DatasetError(f"{slot.path}: {drawn}")
    return drawn


def _differences(stored: Path, made: Path) -> Iterator[str]:
    """Names of what differs between two episode files, the first few."""
    try:
        with open_hdf5(stored) as a, open_hdf5(made) as b:
            names = [f"attribute {name}" for name in sorted({*a.attrs, *b.attrs}) if a.attrs.get(name) != b.attrs.get(name)]
            arrays: list[dict[str, h5py.Dataset]] = [{}, {}]
            for file, found in zip((a, b), arrays, strict=True):
                file.visititems(lambda name, each, to=found: to.update({name: each}) if isinstance(each, h5py.Dataset) else None)
            first, second = arrays
            for name in sorted({*first, *second}):
                if name not in first or name not in second or not _same(first[name], second[name]):
                    names.append(name)
    except OSError:
        names = ["one of the files cannot be read"] if made.is_file() else ["no attempt was accepted"]
    yield from names[:_MOST]
    if len(names) > _MOST:
        yield f"and {len(names) - _MOST} more"


def _same(a: h5py.Dataset, b: h5py.Dataset) -> bool:
    if a.dtype != b.dtype or a.shape != b.shape:
        return False
    first, second = np.asarray(a[()]), np.asarray(b[()])
    # texts are objects, whose bytes are addresses
    return first.tolist() == second.tolist() if first.dtype.hasobject else first.tobytes() == second.tobytes()

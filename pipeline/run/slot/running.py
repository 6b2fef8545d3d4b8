"""What a worker and its driver share beside an episode: what its machine must have, a note on its attempt, files for a store."""

import os
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.data.assets import AssetStore
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.ledger.stamps import file_stamp
from pipeline.data.recipe.model import Slot
from pipeline.data.store.mirror import delete_uploaded, mirror_of, upload
from pipeline.report.summary import failed_folder
from pipeline.run.identity.slot_keys import code_version
from pipeline.world.drawing.vulkan import ensure_renderer

RENEWAL = -1  # stands for the number of an attempt where a stored episode's images or sentences are made again
_SUFFIX = ".running"


def note(dataset: Dataset, slot: Slot, attempt: int) -> None:
    """Write down that an attempt begins."""
    path = _path(dataset, slot)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{attempt} {time.time()}")
    if _elsewhere(dataset):
        upload(path)


def read_note(dataset: Dataset, slot: Slot) -> tuple[int, float] | None:
    """The attempt that runs and when it began (seconds since 1970), or None if there is no note."""
    path = _path(dataset, slot)
    try:
        mirror = None if os.path.lexists(path) else mirror_of(path)
        text = path.read_text() if mirror is None else (mirror.store.read(mirror.name(path)) or b"").decode()
        attempt, began = text.split()
        return int(attempt), float(began)
    except (OSError, ValueError):
        # ValueError: killed between creating the file and writing to it
        return None


def clear(dataset: Dataset, slot: Slot) -> None:
    """Remove the note on a slot, and what its worker, if it was killed, left half-written."""
    path = dataset.episode(slot)
    for left in path.parent.glob(f".{path.name}.*.tmp"):
        left.unlink(missing_ok=True)
    remove_note(dataset, slot)
    delete_uploaded(_path(dataset, slot))


def remove_note(dataset: Dataset, slot: Slot) -> None:
    """Remove the note on a slot that its worker has finished."""
    _path(dataset, slot).unlink(missing_ok=True)
    if _elsewhere(dataset):
        delete_uploaded(_path(dataset, slot))


def _elsewhere(dataset: Dataset) -> bool:
    """Whether this is a worker's mirror of a store, on another machine than the driver's: nobody has pulled it."""
    return mirror_of(dataset.root) is not None and not dataset.manifest.exists()


def clear_all(dataset: Dataset, slots: list[Slot]) -> None:
    """As `clear`, for those of the slots that have a note."""
    folder = _folder(dataset)
    noted = {path.name for path in folder.glob(f"*{_SUFFIX}")}
    for slot in slots if noted else ():
        if _path(dataset, slot).name in noted:
            clear(dataset, slot)
    with suppress(OSError):  # another machine's notes
        folder.rmdir()


def _path(dataset: Dataset, slot: Slot) -> Path:
    # names have single underscores
    return _folder(dataset) / f"{slot.path.replace('/', '__')}{_SUFFIX}"


def _folder(dataset: Dataset) -> Path:
    return dataset.ledger.root / "running"


@dataclass(frozen=True)
class NodeCheck:
    """A check of the machine that a worker is on: whether it reaches the dataset at `root`, and runs the code version `code`."""

    root: str
    code: str

    def __call__(self) -> dict[str, str]:
        """What decides how images look and must be the same on all machines. Raises DatasetError, StoreError, NoRenderer."""
        manifest = Dataset(Path(self.root)).manifest
        mirror = mirror_of(manifest)
        # asked of the store and not fetched: a mirror without a manifest is known for a worker's (run/slot/running.py)
        if not (mirror.store.reach(mirror.name(manifest)) if mirror else manifest.exists()):
            raise DatasetError(f"{self.root} is not there: --out must be where all nodes of the cluster reach it")
        if code_version() != self.code:
            raise DatasetError(f"runs code {code_version()}, the driver {self.code}: install the same version on all nodes")
        return {"renderer": ensure_renderer()}


SHOWN = 2  # episodes of a cell that the report shows: they stay on this machine until it is written


def send_slot(dataset: Dataset, slot: Slot, record: SlotRecord) -> SlotRecord:
    """Send a slot's files: first what the episode and the failed attempts that are kept were drawn from, then these. The entry with
    the stamps that they have from now on; as it is for a dataset in a directory. Raises StoreError.

    The episode's bytes are not kept on this machine.
    """
    mirror = mirror_of(dataset.root)
    if mirror is None:
        return record
    store, path = AssetStore(dataset.bodies), dataset.episode(slot)
    kept = [dataset.failure(slot, row["attempt"]) for row in record.attempts if row.get("kept")]
    named = {key: store.path(key) for key in record.file.assets}
    mirror.push(store.root.glob("*/*.npz") if kept else named.values())
    mirror.push([*kept, *failed_folder(dataset.root, slot.cell.path).glob(f"*-{slot.index}-*.jpg"), dataset.log(slot)])
    if not record.accepted:
        mirror.delete([path])
        return record
    mirror.push([path])
    stamps = {key: file_stamp(asset) for key, asset in named.items()}
    sent = replace(record, file=replace(record.file, stamp=file_stamp(path), assets=stamps))
    if slot.index >= SHOWN:
        mirror.drop(path)
    return sent

"""The files of a slot, sent to the store that holds its dataset."""

from dataclasses import replace

from pipeline.data.assets import AssetStore
from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import Slot
from pipeline.data.records import SlotRecord
from pipeline.data.store.mirror import mirror_of
from pipeline.report.summary import failed_folder

SHOWN = 2  # episodes of a cell that the report shows: they stay on this machine until it is written


def send_slot(dataset: Dataset, slot: Slot, record: SlotRecord) -> SlotRecord:
    """Send a slot's files: first what the episode and the failed attempts that are kept were drawn
    from, then these.

    Returns the record with the time of change that its file has from now on; as it is for a dataset
    in a directory. Raises StoreError.

    The episode's bytes are not kept on this machine.
    """
    mirror = mirror_of(dataset.root)
    if mirror is None:
        return record
    store, path = AssetStore(dataset.bodies), dataset.episode(slot)
    kept = [dataset.failure(slot, row["attempt"]) for row in record.attempts if row.get("kept")]
    mirror.push(
        store.root.glob("*/*.npz") if kept else [store.path(key) for key in record.file.assets]
    )
    mirror.push(
        [
            *kept,
            *failed_folder(dataset.root, slot.cell.path).glob(f"*-{slot.index}-*.jpg"),
            dataset.log(slot),
        ]
    )
    if not record.accepted:
        mirror.delete([path])
        return record
    mirror.push([path])
    sent = replace(record, file=replace(record.file, changed=path.stat().st_mtime_ns))
    if slot.index >= SHOWN:
        mirror.drop(path)
    return sent

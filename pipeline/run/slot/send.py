"""The files of a slot, put to the store that holds its dataset."""

from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import Slot
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.records import SlotRecord
from pipeline.data.store.place import place_of
from pipeline.report.page import failed_folder


def send_slot(dataset: Dataset, slot: Slot, record: SlotRecord) -> None:
    """Put a slot's files to the store, if any: first what they were drawn from. The episode does
    not stay here. Raises StoreError."""
    place = place_of(dataset.root)
    if place is None:
        return
    assets, path = AssetStore(dataset.bodies), dataset.episode(slot)
    kept = [dataset.failure(slot, row["attempt"]) for row in record.attempts if row.get("kept")]
    drawn = assets.root.glob("*/*.npz") if kept else map(assets.path, record.file.assets)
    place.put(path for path in drawn if path.exists())  # another worker may have put it
    failed = failed_folder(dataset.root, slot.cell.path).glob(f"*-{slot.index}-*.jpg")
    place.put(path for path in (*kept, *failed, dataset.log(slot)) if path.exists())
    if record.accepted:
        place.put([path])
        path.unlink()
    else:
        place.delete([path])

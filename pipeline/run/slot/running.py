"""What a worker and its driver share beside an episode: what its machine must have, and files for a store."""

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.data.assets import AssetStore
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.recipe.model import Slot
from pipeline.data.records import SlotRecord
from pipeline.data.store.mirror import mirror_of
from pipeline.report.summary import failed_folder
from pipeline.run.identity.slot_keys import code_version
from pipeline.world.drawing.vulkan import ensure_renderer


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
    """Send a slot's files: first what the episode and the failed attempts that are kept were drawn from, then these.

    Returns the record with the time of change that its file has from now on; as it is for a dataset in a directory. Raises
    StoreError.

    The episode's bytes are not kept on this machine.
    """
    mirror = mirror_of(dataset.root)
    if mirror is None:
        return record
    store, path = AssetStore(dataset.bodies), dataset.episode(slot)
    kept = [dataset.failure(slot, row["attempt"]) for row in record.attempts if row.get("kept")]
    mirror.push(store.root.glob("*/*.npz") if kept else [store.path(key) for key in record.file.assets])
    mirror.push([*kept, *failed_folder(dataset.root, slot.cell.path).glob(f"*-{slot.index}-*.jpg"), dataset.log(slot)])
    if not record.accepted:
        mirror.delete([path])
        return record
    mirror.push([path])
    sent = replace(record, file=replace(record.file, changed=path.stat().st_mtime_ns))
    if slot.index >= SHOWN:
        mirror.drop(path)
    return sent

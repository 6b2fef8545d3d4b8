"""The index, read from the slots' files."""

import errno
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.data.atomic import Busy, atomic_path, exclusive
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.errors import DAMAGE
from pipeline.data.keys import Key, SlotKeys, file_hash, is_intact
from pipeline.data.process.machine import usable_cores
from pipeline.data.reading import check_regular
from pipeline.data.recipe.cells import Slot
from pipeline.data.recipe.model import Recipe
from pipeline.data.store.place import drop, place_of

from .files import Listing, Paths, read_given_up
from .index import BESIDE, DamagedIndex, Index
from .records import ATTEMPTS, MOST_ATTEMPTS, PLACE, TIMED, FileFacts, SlotRecord, retimed, untimed

_NOT_OURS = (EpisodeError, KeyError, TypeError, ValueError, AttributeError)
"""What reading raises for what is no whole file of its slot."""

_UNWRITABLE = (errno.EROFS, errno.EACCES, errno.EPERM)

# rows of attempts.parquet by place
type Attempts = Mapping[tuple[Any, ...], Sequence[dict[str, Any]]]


def ask_index[T](dataset: Paths, recipe: Callable[[], Recipe], question: Callable[[Index], T]) -> T:
    """What an index answers. A lost one is made again, in memory if it cannot be written."""
    try:
        with Index(dataset.index) as index:
            return question(index)
    except DamagedIndex:
        pass
    try:
        with exclusive(dataset.root), rebuild_index(dataset, recipe()) as index:
            return question(index)
    except (Busy, OSError) as error:
        if isinstance(error, OSError) and error.errno not in _UNWRITABLE:
            raise
    with Index(Path(":memory:"), new=True) as index:
        read_unknown(dataset, recipe(), index)
        return question(index)


def rebuild_index(dataset: Paths, recipe: Recipe) -> Index:
    """Make a dataset's index again. Raises OSError."""
    with atomic_path(dataset.index) as temporary:
        with Index(temporary, new=True) as index:
            read_unknown(dataset, recipe, index)
        # what a killed command left to be rolled back is not of this index
        for end in BESIDE:
            Path(f"{dataset.index}{end}").unlink(missing_ok=True)
    return Index(dataset.index)


IDLE = 4.0  # times its last commit took, a writer waits: a slow disk costs a fifth
PUT = 300.0  # seconds between the copies of the index that a store gets while it is written


class IndexWriter(AbstractContextManager["IndexWriter"]):
    """The index of the writing command. Fast slots share a commit; lost rows are read from files
    again.
    """

    def __init__(self, dataset: Paths, recipe: Recipe) -> None:
        self._dataset, self._recipe, self._put_at = dataset, recipe, 0.0
        self._waiting, self._free_at = list[tuple[Slot, SlotRecord]](), 0.0
        try:
            self.index = Index(dataset.index)
        except DamagedIndex:
            self.index = rebuild_index(dataset, recipe)

    def __exit__(self, *_: object) -> None:
        try:
            self.flush()
        finally:
            self.index.close()

    def add(self, slot: Slot, record: SlotRecord) -> None:
        """Write a slot that ended. Raises OSError."""
        if place := place_of(self._dataset.root):
            place.note(self._dataset.file(slot, record.accepted), record.file.size)
        self._waiting.append((slot, record))
        if time.monotonic() >= self._free_at:
            self.flush()

    def flush(self) -> None:
        """Commit what waits. Raises OSError."""
        began, waiting = time.monotonic(), self._waiting
        if not waiting:
            return
        try:
            self.index.add(waiting)
        except DamagedIndex:
            self.index.close()
            self.index = rebuild_index(self._dataset, self._recipe)
            self.index.add(waiting)
        self._waiting, ended = [], time.monotonic()
        self._free_at = ended + IDLE * (ended - began)
        if (place := place_of(self._dataset.root)) and ended >= self._put_at:
            place.put([self._dataset.index])
            self._put_at = ended + PUT

    def catch_up(self) -> set[Slot]:
        """Add rows for whole files; returns slots whose bytes changed. Raises OSError."""
        self.flush()
        read_unknown(self._dataset, self._recipe, self.index)
        rows = self.index.rows(self._recipe, "size", "changed", "sha256")
        now = Listing(self._dataset.episodes, self._recipe).states(rows)
        known = np.stack([rows.more["size"], rows.more["changed"]], axis=1)
        # of a file on a store only the size is known
        touched = (now[:, 0] >= 0) & ((now != known) & (now != [-1, 0])).any(axis=1)
        rows, now = rows.where(touched), now[touched]
        paths = [
            self._dataset.file(slot, accepted)
            for slot, accepted in zip(rows.slots, rows.accepted.tolist(), strict=True)
        ]
        hashes = (sha256.hex() for sha256 in rows.more["sha256"])
        with ThreadPoolExecutor(usable_cores()) as threads:
            same = np.array(list(threads.map(is_intact, paths, hashes)), bool)
        self.index.update_files(np.column_stack([rows.ids, now])[same].tolist())
        return set(rows.where(~same).slots)


def read_unknown(dataset: Paths, recipe: Recipe, index: Index) -> None:
    """Add the slots whose files are whole and have no row. Raises OSError."""
    unknown = list(Listing(dataset.episodes, recipe).unknown(index.rows(recipe)))
    measured = _measured(dataset) if unknown else {}
    for slot, accepted in unknown:
        tried = measured.get((*vars(slot.cell).values(), slot.index), ())
        with suppress(*_NOT_OURS):
            read = _read_episode if accepted else _read_given_up
            index.add([(slot, read(dataset, slot, tried))])
        drop(dataset.file(slot, accepted))


def _read_episode(dataset: Paths, slot: Slot, tried: Sequence[dict[str, Any]]) -> SlotRecord:
    """Raises one of _NOT_OURS unless the slot's whole episode."""
    path = dataset.episode(slot)
    with EpisodeFile(path) as file:
        meta, spec = file.meta, file.spec
        place = [getattr(spec, name) for name in PLACE]
        if (
            place != [*vars(slot.cell).values(), slot.index]
            or (meta.variant, meta.failure) != (slot.variant, None)
            or file.damaged()
        ):
            raise ValueError("is not whole, or not the episode of this slot")
        attempts, frames = file.attempts(), len(file)
        if attempts is None:  # version 0.1 kept them in the table alone
            own = {"attempt": 0, "seed": spec.seed, "outcome": "accepted"}
            attempts = untimed(tried) or [own]
    file = FileFacts.of(path.stat(), frames, meta.physics_id, list(meta.drawing.assets.values()))
    rows = () if slot.variant else retimed(slot, attempts, _seconds(tried, attempts))
    return SlotRecord(_keys(meta), True, file_hash(path), rows, file=file)


def _keys(meta: EpisodeMeta) -> SlotKeys:
    """The keys of an episode. Raises ValueError if they do not match their parts."""
    if not meta.keys:  # of another version
        return SlotKeys(Key({}), Key({}), Key({}))
    keys = SlotKeys.from_json(meta.keys)
    if (meta.physics_key, meta.render_key) != (keys.physics.digest, keys.render.digest):
        raise ValueError("its keys are not those of their parts")
    return keys


def _read_given_up(dataset: Paths, slot: Slot, tried: Sequence[dict[str, Any]]) -> SlotRecord:
    """Raises one of _NOT_OURS unless a note on the slot."""
    path = dataset.file(slot, False)
    keys, attempts = read_given_up(path, slot.path)
    rows = retimed(slot, attempts, _seconds(tried, attempts))
    return SlotRecord(keys, False, file_hash(path), rows, file=FileFacts.of(path.stat()))


def _measured(dataset: Paths) -> Attempts:
    """Rows of attempts.parquet, none if missing or damaged."""
    try:
        check_regular(dataset.attempts)
        with pq.ParquetFile(dataset.attempts) as file:
            if file.metadata.num_rows > MOST_ATTEMPTS:
                return {}
        table = pq.read_table(dataset.attempts, schema=ATTEMPTS).to_pylist()
    except (*DAMAGE, pa.ArrowException):
        return {}
    rows = defaultdict[tuple[Any, ...], list[dict[str, Any]]](list)
    for row in sorted(table, key=lambda row: row["attempt"] or 0):
        rows[tuple(row[name] for name in PLACE)].append(row)
    return rows


def _seconds(
    tried: Sequence[Mapping[str, Any]], attempts: Sequence[Mapping[str, Any]]
) -> dict[int, float]:
    """Seconds by attempt of the same seed in attempts.parquet."""
    seeds = {row["attempt"]: row["seed"] for row in attempts}
    return {
        row["attempt"]: row[TIMED]
        for row in tried
        if seeds.get(row["attempt"]) == row["seed"] and row[TIMED] is not None
    }

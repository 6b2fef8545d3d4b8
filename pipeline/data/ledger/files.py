"""The ledger of a dataset on disk: which slots are finished, and everything that is known of them.

    ledger/<task>/<embodiment>.parquet    every entry of a task and a robot, sorted by cell, slot and variant (ledger_table.py)
    ledger/journal/0000000017.jsonl       entries that came after those files were written, one canonical JSON a line

The process that drives a build is the only one that writes here. Workers return entries; the driver writes them as they come, each
time in a new segment of the journal. Segments and files appear whole, by rename, and are never appended to, so that a process
killed at any moment leaves whole entries only, and a store of objects that cannot be appended to can hold them as well. Entries
that come faster than they can be written, at a fifth of the driver's time, wait for one another and share a segment: killing the
driver loses at most those, and their slots are made again to the same bytes. `compact` moves the journal into the sorted files:
when the journal has grown to a 16th of them, when a build ends, and when the next one begins. It writes the files before it deletes
segments, oldest first, and an entry of a later segment replaces one of an earlier segment or of a file; so it can be repeated from
wherever it was stopped. What is left in the end depends on the entries alone, not on how many workers made them, in which order, or
how often the build was stopped: but for what was measured (seconds and stamps), the same entries give the same bytes.

A reader takes the journal first and the files second, and so misses nothing that a compaction moves in between. A damaged file
counts as no entries, a damaged line of the journal as none: their slots are made again.
"""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa

from pipeline.data.atomic import remove, write_atomic
from pipeline.data.keys import canonical
from pipeline.data.ledger.columns import mask_of, numbers, rows_of
from pipeline.data.ledger.records import NO_RECORD, SlotRecord
from pipeline.data.ledger.table import PLACE, decode, empty, encode, place_of, record_of, select_columns, slot_of, table_of
from pipeline.data.parsing import parse_json
from pipeline.data.reading import IRREGULAR, read_regular
from pipeline.data.recipe.model import Slot
from pipeline.data.store.mirror import delete_uploaded, upload

FEWEST, SHARE = 2048, 16
"""The journal is moved into the files when it has so many entries, and a 16th of theirs."""

IDLE = 4.0
"""The driver waits so many times as long as the last segment took to write before it writes the next."""

type Group = tuple[str, str]
"""A task and a robot, whose entries are one file."""


class DamagedLedger(ValueError):
    """A file of the ledger that cannot be decoded."""


@dataclass
class Journal:
    """Entries that are not in the files yet, by task and robot; one line for each that cannot be read; the segments they are in."""

    entries: dict[Group, dict[Slot, SlotRecord]] = field(default_factory=lambda: defaultdict(dict))
    problems: list[str] = field(default_factory=list)
    segments: list[Path] = field(default_factory=list)


class Ledger:
    """The ledger below a directory. Nothing is kept between two calls: what is read is what is there."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root)

    def file(self, group: Group) -> Path:
        """The file of a task and a robot."""
        return self.root / group[0] / f"{group[1]}.parquet"

    @property
    def segments(self) -> Path:
        """The directory of the journal."""
        return self.root / "journal"

    def groups(self) -> list[Group]:
        """Tasks and robots that have a file or entries of the journal, sorted."""
        files = {(p.parent.name, p.stem) for p in self.root.glob("*/*.parquet")}
        return sorted(files | set(self.journal().entries))

    def journal(self) -> Journal:
        """What the journal holds now, the latest entry of every slot. Raises OSError for a segment that cannot be read."""
        found = Journal(segments=_sort_segments(self.segments))
        for path in list(found.segments):
            try:
                lines = read_regular(path).splitlines()
            except FileNotFoundError:
                found.segments.remove(path)  # moved into the files meanwhile
                continue
            for number, line in enumerate(lines, 1):
                try:
                    slot, record = _entry(line)
                except NO_RECORD as error:
                    why = " ".join(str(error).split())[:200]
                    found.problems.append(f"journal/{path.name}: line {number} cannot be read ({why})")
                else:
                    found.entries[group_of(slot)][slot] = record
        return found

    def table(self, group: Group, journal: Journal | None = None, columns: Sequence[str] | None = None) -> pa.Table:
        """The rows of a task and a robot as they are now; of a damaged file none. Raises OSError if it cannot be read."""
        journal = journal or self.journal()
        newer = journal.entries.get(group, {})
        try:
            base = self.read_rows(group, columns)
        except DamagedLedger:
            base = empty(columns)
        if not newer:
            return base
        replaced, indices = {place_of(slot) for slot in newer}, [slot.index for slot in newer]
        near = np.flatnonzero(np.isin(numbers(base["slot"], -1), indices))  # the only rows that can be of these slots
        places = list(zip(*(base[name].take(rows_of(near)).to_pylist() for name in PLACE), strict=True))
        stays = np.ones(len(base), bool)
        stays[near] = [place not in replaced for place in places]
        return pa.concat_tables([base.filter(mask_of(stays)), select_columns(table_of(newer.items()), columns)])

    def read_rows(self, group: Group, columns: Sequence[str] | None = None) -> pa.Table:
        """The rows of a file. Raises DamagedLedger for one that cannot be decoded, OSError if the disk refuses."""
        try:
            return decode(read_regular(self.file(group)), columns)
        except FileNotFoundError:
            return empty(columns)
        except (pa.ArrowException, *NO_RECORD) as error:
            raise DamagedLedger(" ".join(str(error).split())[:200]) from error
        except OSError as error:
            # what is no file, and what the decoder says of a damaged page: it raises OSError without a number for that
            if error.strerror == IRREGULAR or error.errno is None:
                raise DamagedLedger(" ".join((error.strerror or str(error)).split())[:200]) from error
            raise

    def entries(self) -> Iterator[tuple[Slot, SlotRecord]]:
        """Every entry that can be read, whatever the recipe."""
        journal = self.journal()
        for group in self.groups():
            yield from records_of(self.table(group, journal))

    def next_segment(self) -> int:
        """The number of the next segment of the journal."""
        there = _sort_segments(self.segments)
        return int(there[-1].stem) + 1 if there else 0

    def add(self, entries: Iterable[tuple[Slot, SlotRecord]], number: int | None = None) -> None:
        """Write entries as one new segment of the journal. Raises OSError if the disk refuses."""
        path = self.segments / f"{self.next_segment() if number is None else number:010d}.jsonl"
        write_atomic(path, b"".join(line_of(slot, record) for slot, record in entries))
        upload(path)

    def compact(self) -> int:
        """Move the journal into the files; how many entries these hold then, of the tasks and robots that changed.
        Raises OSError if the disk refuses."""
        journal, rows = self.journal(), 0
        for group in sorted(journal.entries):
            table, path = self.table(group, journal), self.file(group)
            if path.is_dir():
                remove(path)
            write_atomic(path, encode(table))
            upload(path)
            rows += len(table)
        for segment in journal.segments:
            remove(segment)
        delete_uploaded(*journal.segments)
        if journal.segments:
            with suppress(OSError):  # another process has written a segment meanwhile
                self.segments.rmdir()
        return rows


class LedgerWriter:
    """Writes entries as they come; the driver of a build has one."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._waiting: list[tuple[Slot, SlotRecord]] = []
        self._number, self._free_at = ledger.next_segment(), 0.0
        self._count, self._most = 0, FEWEST

    def add(self, slot: Slot, record: SlotRecord) -> None:
        """Write an entry, at once unless the last one was written just now. Raises OSError if the disk refuses."""
        self._waiting.append((slot, record))
        if time.monotonic() >= self._free_at:
            self.flush()

    def flush(self) -> None:
        """Write what waits."""
        if not self._waiting:
            return
        began = time.monotonic()
        self._ledger.add(self._waiting, self._number)
        self._number += 1
        self._count += len(self._waiting)
        self._waiting = []
        ended = time.monotonic()
        self._free_at = ended + IDLE * (ended - began)
        if self._count >= self._most:
            self._most = max(FEWEST, self._ledger.compact() // SHARE)
            self._count = 0

    def close(self) -> None:
        """Write what waits, and move the journal into the files."""
        self.flush()
        self._ledger.compact()


def group_of(slot: Slot) -> Group:
    """The task and the robot of a slot."""
    return slot.cell.task, slot.cell.embodiment


def records_of(table: pa.Table) -> Iterator[tuple[Slot, SlotRecord]]:
    """The entries of a table in its order, without rows that are none."""
    for batch in table.to_batches(max_chunksize=1024):
        for row in batch.to_pylist():
            with suppress(*NO_RECORD):
                yield slot_of(row), record_of(row)


def line_of(slot: Slot, record: SlotRecord) -> bytes:
    """An entry as a line of the journal."""
    place = canonical(dict(zip(PLACE, place_of(slot), strict=True)))
    return b'{"place":' + place + b',"record":' + record.to_json() + b"}\n"


def _entry(line: bytes) -> tuple[Slot, SlotRecord]:
    """Inverse of `line_of`. Raises what NO_RECORD names for a line that is none."""
    values = parse_json(line)
    return slot_of(values["place"]), SlotRecord.from_values(values["record"])


def _sort_segments(directory: Path) -> list[Path]:
    """Segments in the order in which they were written."""
    return sorted(p for p in directory.glob("*.jsonl") if p.stem.isdecimal())

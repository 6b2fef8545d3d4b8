"""The index of a dataset: an SQLite cache of what the files of the slots state (reread.py)."""

import errno
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.recipe.cells import Slot
from pipeline.data.recipe.model import Recipe
from pipeline.poses import Ints

from .files import Rows
from .records import ATTEMPTS, OF_ATTEMPT, PLACE, FileFacts, SlotRecord, pack_keys, unpack_keys

VERSION = 2
WAIT = 60.0  # seconds that a command waits for another to finish reading or writing

FULL = ("sha256", "size", "changed", "frames", "physics_id", "assets", "seconds", "core_seconds")
"""Columns of a record."""

_SLOT = ("cell", "slot", "variant", "accepted", "keys", *FULL)
_CELL = PLACE[:5]
_KINDS = {pa.string(): "TEXT", pa.float64(): "REAL", pa.list_(pa.string()): "TEXT"}
_ATTEMPT = ", ".join(
    f"{name} {_KINDS.get(ATTEMPTS.field(name).type, 'INTEGER')}" for name in OF_ATTEMPT[1:]
)
_TABLES = (
    "CREATE TABLE cell (id INTEGER PRIMARY KEY, task TEXT, embodiment TEXT, level INTEGER,"
    f" alpha REAL, domain TEXT, UNIQUE ({', '.join(_CELL)})) STRICT",
    "CREATE TABLE keys (id INTEGER PRIMARY KEY, text TEXT UNIQUE) STRICT",
    "CREATE TABLE asset (id INTEGER PRIMARY KEY, text TEXT UNIQUE) STRICT",
    "CREATE TABLE slot (id INTEGER PRIMARY KEY, cell INTEGER NOT NULL REFERENCES cell,"
    " slot INTEGER NOT NULL, variant INTEGER NOT NULL, accepted INTEGER NOT NULL,"
    " keys INTEGER NOT NULL REFERENCES keys, sha256 BLOB NOT NULL, size INTEGER NOT NULL,"
    " changed INTEGER NOT NULL, frames INTEGER NOT NULL, physics_id BLOB NOT NULL,"
    " assets TEXT NOT NULL, seconds REAL NOT NULL, core_seconds REAL NOT NULL,"
    " UNIQUE (cell, slot, variant)) STRICT",
    f"CREATE TABLE attempt (owner INTEGER NOT NULL, attempt INTEGER NOT NULL, {_ATTEMPT},"
    " PRIMARY KEY (owner, attempt)) STRICT, WITHOUT ROWID",
)
_CHECKS = {
    "PRAGMA user_version": [(VERSION,)],
    "SELECT sql FROM sqlite_schema WHERE sql NOT NULL ORDER BY rowid": [(sql,) for sql in _TABLES],
    "PRAGMA quick_check(1)": [("ok",)],
    "PRAGMA foreign_key_check": [],
}
_WANTED = f"CREATE TEMP TABLE IF NOT EXISTS wanted (rank, count, {', '.join(_CELL)})"

_REFUSED = {
    sqlite3.SQLITE_FULL: errno.ENOSPC,
    sqlite3.SQLITE_IOERR: errno.EIO,
    sqlite3.SQLITE_READONLY: errno.EROFS,
    sqlite3.SQLITE_CANTOPEN: errno.EACCES,
    sqlite3.SQLITE_BUSY: errno.EBUSY,
}


class DamagedIndex(Exception):
    """An index that is missing, unreadable or of another version: it is made again."""


@contextmanager
def _faults(path: Path) -> Iterator[None]:
    """Raise OSError if the disk refuses, ValueError for wrong column values, DamagedIndex for
    all else.
    """
    try:
        yield
    except (sqlite3.IntegrityError, sqlite3.ProgrammingError, OverflowError) as error:
        raise ValueError(f"{path}: {error}") from error
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorcode", 0)
        number = None if code == sqlite3.SQLITE_READONLY_DBMOVED else _REFUSED.get(code & 0xFF)
        if number is None or not path.exists():
            raise DamagedIndex(f"{path}: {error}") from error
        raise OSError(number, os.strerror(number), str(path)) from error


BESIDE = ("-journal", "-wal", "-shm")  # what SQLite looks for beside a database
# the end of a journal that names files to delete (sqlite.org/fileformat.html, section 3)
_SUPER_JOURNAL = bytes.fromhex("d9d505f920a163d7")


def _check_beside(path: Path) -> None:
    """Raise DamagedIndex for a hard link or foreign journal, by which SQLite would change files
    elsewhere.
    """
    with path.open("rb") as file:
        plain = file.read(20)[18:] == b"\1\1" and path.stat().st_nlink == 1
    for end in BESIDE:
        with suppress(FileNotFoundError), Path(f"{path}{end}").open("rb") as file:
            size, links = file.seek(0, os.SEEK_END), os.fstat(file.fileno()).st_nlink
            file.seek(max(size - 8, 0))
            plain &= end == "-journal" and links <= 1 and file.read() != _SUPER_JOURNAL
    if not plain:
        raise DamagedIndex(f"{path}: it or a file beside it is not of ours")


class Index(AbstractContextManager["Index"]):
    """An open index, or ":memory:". Raises DamagedIndex."""

    def __init__(self, path: Path, new: bool = False) -> None:
        self.path = path
        if not new and not path.exists():
            raise DamagedIndex(f"{path}: is missing")
        with _faults(path), ExitStack() as opened:
            if not new:
                _check_beside(path)
            self._file = sqlite3.connect(path, timeout=WAIT, check_same_thread=False)
            opened.enter_context(closing(self._file))
            # what is in a file from elsewhere must not run
            self._file.execute("PRAGMA trusted_schema = OFF")
            if new:  # it gets its name when it is whole
                first = ("PRAGMA synchronous = OFF", "PRAGMA journal_mode = MEMORY", *_TABLES)
                self._file.executescript(f"{';'.join(first)};PRAGMA user_version = {VERSION}")
            for question, answer in _CHECKS.items():
                if self._file.execute(question).fetchall() != answer:
                    raise DamagedIndex(f"{path}: is damaged or of another version")
            opened.pop_all()

    def __exit__(self, *_: object) -> None:
        self._file.close()

    close = __exit__

    def add(self, entries: Iterable[tuple[Slot, SlotRecord]]) -> None:
        """Write slots that ended, all or none. Raises ValueError, OSError, DamagedIndex."""
        with _faults(self.path), self._file:
            for slot, record in entries:
                file = record.file
                cell = self._number("cell", _CELL, tuple(vars(slot.cell).values()))
                keys = self._number("keys", ("text",), (pack_keys(slot, record.keys),))
                numbers = (self._number("asset", ("text",), (key,)) for key in file.assets)
                place = (cell, slot.index, slot.variant, record.accepted, keys)
                facts = (bytes.fromhex(record.sha256), file.size, file.changed, file.frames)
                named = (bytes.fromhex(file.physics_id), " ".join(map(str, numbers)))
                update = ", ".join(f"{name} = excluded.{name}" for name in _SLOT[3:])
                [(owner,)] = self._file.execute(
                    f"{_insert('slot', _SLOT)} ON CONFLICT DO UPDATE SET {update} RETURNING id",
                    (*place, *facts, *named, record.seconds, record.core_seconds),
                ).fetchall()
                self._file.execute("DELETE FROM attempt WHERE owner = ?", (owner,))
                for row in record.attempts:
                    failed = row.get("conditions")
                    row = row | {"conditions": None if failed is None else json.dumps(failed)}
                    values = (owner, *map(row.get, OF_ATTEMPT))
                    self._file.execute(_insert("attempt", ("owner", *OF_ATTEMPT)), values)

    def _number(self, table: str, columns: Sequence[str], values: tuple[Any, ...]) -> int:
        """The number of a row that slots share, added if it is new."""
        where = " AND ".join(f"{name} = ?" for name in columns)
        find = f"SELECT id FROM {table} WHERE {where}"
        if (found := self._file.execute(find, values).fetchone()) is None:
            self._file.execute(_insert(table, columns), values)
            found = self._file.execute(find, values).fetchone()
        return found[0]

    def update_files(self, files: Iterable[tuple[int, int, int]]) -> None:
        """Write size (bytes) and time of change (ns) of files, as rows (id, size, changed)."""
        with _faults(self.path), self._file:
            self._file.executemany("UPDATE slot SET size = ?2, changed = ?3 WHERE id = ?1", files)

    def rows(self, recipe: Recipe, *more: str, of: Slot | None = None) -> Rows:
        """The slots of a recipe that are there, or `of` one, with more columns of their table."""
        cells = list(recipe.counts())
        wanted = [
            (rank, count, *vars(cell).values())
            for rank, (cell, count) in enumerate(recipe.counts().items())
            if of is None or of.cell == cell
        ]
        names = ("slot.id", "rank", "slot", "variant", "accepted", "keys", *more)
        one = (of.index, of.variant) if of else ()
        with _faults(self.path), self._file:
            self._file.execute(_WANTED)
            self._file.execute("DELETE FROM wanted")
            self._file.executemany(_insert("wanted", ("rank", "count", *_CELL)), wanted)
            found = self._file.execute(
                f"SELECT {', '.join(names)} FROM wanted JOIN cell USING ({', '.join(_CELL)})"
                " JOIN slot ON slot.cell = cell.id WHERE slot < count AND variant < ?"
                f"{' AND slot = ? AND variant = ?' if of else ''} ORDER BY slot, rank, variant",
                (recipe.variants, *one),
            ).fetchall()
            texts = dict(self._file.execute("SELECT id, text FROM keys").fetchall())
        columns = [_column(values) for values in zip(*found, strict=True)]
        ids, ranks, index, variants, accepted, keys, *others = columns or [
            np.zeros(0, np.int64) for _ in names
        ]
        known = dict(zip(more, others, strict=True))
        return Rows(cells, ids, ranks, index, variants, accepted == 1, keys, texts, known)

    def attempts(self, rows: Rows, *names: str) -> tuple[Ints, list[tuple[Any, ...]]]:
        """Columns of all attempts at the slots of some rows: each one's row number (M,), and its
        values.
        """
        with _faults(self.path):
            found = self._file.execute(
                f"SELECT key, {', '.join(names)} FROM json_each(?) CROSS JOIN attempt"
                " ON owner = json_each.value ORDER BY key, attempt",
                (json.dumps(rows.ids.tolist()),),
            ).fetchall()
        of = np.fromiter((row[0] for row in found), np.int64, len(found))
        return of, [row[1:] for row in found]

    def records(self, rows: Rows) -> Iterator[tuple[Slot, SlotRecord]]:
        """Every row in full; the rows need the columns of `FULL`."""
        of, tried = self.attempts(rows, *OF_ATTEMPT)
        ends = np.searchsorted(of, np.arange(len(rows) + 1)).tolist()
        assets, columns = self.assets(), (rows.more[name].tolist() for name in FULL)
        for number, (slot, accepted, keys, *values) in enumerate(
            zip(rows.slots, rows.accepted.tolist(), rows.keys.tolist(), *columns, strict=True)
        ):
            sha256, size, changed, frames, physics_id, named, seconds, core = values
            place = vars(slot.cell) | {"slot": slot.index}
            attempts = tuple(place | _row(each) for each in tried[ends[number] : ends[number + 1]])
            shown = tuple(assets[int(each)] for each in named.split())
            file = FileFacts(size, changed, frames, physics_id.hex(), shown)
            held = unpack_keys(slot, rows.texts[keys])
            yield slot, SlotRecord(held, accepted, sha256.hex(), attempts, seconds, core, file)

    def record(self, recipe: Recipe, slot: Slot) -> SlotRecord | None:
        """What is known of a slot, None if it is not finished."""
        found = self.records(self.rows(recipe, *FULL, of=slot))
        return next((record for _, record in found), None)

    def assets(self) -> dict[int, str]:
        """The hashes of assets by their numbers in the column `assets`."""
        with _faults(self.path):
            return dict(self._file.execute("SELECT id, text FROM asset").fetchall())


def _insert(table: str, columns: Sequence[str]) -> str:
    return f"INSERT INTO {table} ({', '.join(columns)}) VALUES ({', '.join('?' * len(columns))})"


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Values (N,); NumPy would cut zeros from the end of bytes."""
    return np.array(values, object if isinstance(values[0], str | bytes) else None)


def _row(values: Sequence[Any]) -> dict[str, Any]:
    """An attempt from its columns, without empty ones."""
    row = {name: value for name, value in zip(OF_ATTEMPT, values, strict=True) if value is not None}
    return row | {"conditions": json.loads(row["conditions"])} if "conditions" in row else row

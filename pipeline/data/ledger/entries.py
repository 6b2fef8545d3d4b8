"""The ledger as it was at one moment, for the slots of a recipe and in its order: what status, builds, exports and reports read."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow.compute import MatchSubstringOptions, call_function

from pipeline.data.ledger.columns import codes, flags, mask_of, numbers, parents, rows_of, single, valid
from pipeline.data.ledger.files import Ledger
from pipeline.data.ledger.records import ATTEMPTS, NO_RECORD, SlotRecord
from pipeline.data.ledger.stamps import stamp_of
from pipeline.data.ledger.table import PLACE, SCHEMA, cell_of, record_of
from pipeline.data.recipe.cells import Cell, Slot, episode_name
from pipeline.data.recipe.model import Recipe

_OWN = PLACE[:-1]
_ROWS = 1024
_HASH, _EMPTY = MatchSubstringOptions("^[0-9a-f]{64}$"), MatchSubstringOptions("^$")


@dataclass(frozen=True, eq=False)
class Entries:
    """Some columns of the entries of a recipe's slots, one row each, in the recipe's order. What cannot be (an accepted slot
    without a hash) is left out, and `impossible`: its slot counts as not finished.

    `cells` are those of the recipe, `ranks` (N,) is the number of every row's cell among them. Of the attempts, some columns alone
    are read where they are named like "attempts.reason".
    """

    cells: Sequence[Cell]
    table: pa.Table
    ranks: NDArray[np.int64]
    impossible: list[Slot]

    @classmethod
    def read(cls, ledger: Ledger, recipe: Recipe, columns: Sequence[str] | None = None) -> "Entries":
        """The entries as they are on disk now, with these columns besides those that name and judge a slot, or with all."""
        wanted = SCHEMA.names if columns is None else list(dict.fromkeys((*PLACE, "accepted", "sha256", *columns)))
        journal = ledger.journal()
        groups = list(product(recipe.tasks, recipe.embodiments))
        table = pa.concat_tables([ledger.table(group, journal, wanted) for group in groups])
        return cls(recipe.cells(), *_in_order(table, recipe))

    @cached_property
    def slots(self) -> list[Slot]:
        """The slot of every row."""
        rows = zip(self.ranks.tolist(), *self.numbers, strict=True)
        return [Slot(self.cells[rank], index, variant) for rank, index, variant in rows]

    @cached_property
    def numbers(self) -> tuple[list[int], list[int]]:
        """Every row's number of slot and of variant."""
        return numbers(self.table["slot"]).tolist(), numbers(self.table["variant"]).tolist()

    @cached_property
    def accepted(self) -> list[bool]:
        """Whether every row's slot was accepted."""
        return flags(self.table["accepted"]).tolist()

    def records(self) -> Iterator[tuple[Slot, SlotRecord | None]]:
        """Every row in full, None for one that is no entry. All columns must have been read."""
        for start in range(0, len(self.table), _ROWS):
            rows = self.table.slice(start, _ROWS).to_pylist()
            for slot, row in zip(self.slots[start : start + _ROWS], rows, strict=True):
                try:
                    yield slot, record_of(row)
                except NO_RECORD:
                    yield slot, None

    def where(self, mask: Sequence[bool] | NDArray[np.bool_]) -> "Entries":
        """Those rows where the mask is true."""
        chosen = np.asarray(mask, bool)
        return replace(self, table=self.table.filter(mask_of(chosen)), ranks=self.ranks[chosen])

    def attempts(self) -> pa.Table:
        """All attempts, as a table with the columns ATTEMPTS, those of a slot together. `attempts` must have been read."""
        column = single(self.table["attempts"])
        if not len(column):
            return ATTEMPTS.empty_table()
        rows, flat = rows_of(parents(column)), column.flatten()
        arrays = []
        for name in ATTEMPTS.names:
            values = flat.field(name)
            own = single(self.table[name].take(rows)) if name in _OWN else None
            arrays.append(values if own is None else call_function("coalesce", [values, own]))
        return pa.table(arrays, schema=ATTEMPTS)


def _in_order(table: pa.Table, recipe: Recipe) -> tuple[pa.Table, NDArray[np.int64], list[Slot]]:
    """The rows that are entries of the recipe's slots, the cell number of each row (N,), and the slots of impossible entries.

    Each slot occurs once; the rows are in the recipe's order."""
    if not len(table):
        return table, np.empty(0, np.int64), []
    table = table.combine_chunks()
    ranks, index, variant = _ranks(table, recipe), numbers(table["slot"], -1), numbers(table["variant"], -1)
    wanted = np.array(list(recipe.counts().values()))
    known = (ranks >= 0) & (index >= 0) & (index < wanted[ranks]) & (variant >= 0) & (variant < recipe.variants)
    accepted = flags(table["accepted"])
    hashed, empty = (flags(call_function("match_substring_regex", [table["sha256"]], how)) for how in (_HASH, _EMPTY))
    possible = np.where(accepted, hashed, empty)
    if "attempts" in table.column_names:
        possible &= _fitting(single(table["attempts"]), accepted)
    places = zip(*(table[name].filter(mask_of(known & ~possible)).to_pylist() for name in PLACE), strict=True)
    impossible = [Slot(cell_of(*cell), number, look) for *cell, number, look in places]
    known &= possible
    order = np.lexsort((variant, ranks, index))
    order = order[known[order]]
    sorted_places = np.stack([variant, ranks, index])[:, order]
    first = np.ones(len(order), bool)
    first[1:] = (sorted_places[:, 1:] != sorted_places[:, :-1]).any(axis=0)
    kept = order[first]
    return table.take(rows_of(kept)), ranks[kept], impossible


def _ranks(table: pa.Table, recipe: Recipe) -> NDArray[np.int64]:
    """The number of every row's cell among those of the recipe, -1 for another one."""
    cells = {(c.task, c.embodiment, c.level, c.alpha, c.domain): number for number, c in enumerate(recipe.counts())}
    combined, values = np.zeros(len(table), np.int64), list[list[Any]]()
    for name in PLACE[:5]:
        numbered, different = codes(table[name])
        combined = combined * (len(different) + 1) + numbered + 1
        values.append([None, *different])
    different, inverse = np.unique(combined, return_inverse=True)
    of_each = list[int]()
    for code in different.tolist():
        cell = list[Any]()
        for column in reversed(values):
            code, number = divmod(code, len(column))
            cell.insert(0, column[number])
        of_each.append(cells.get(tuple(cell), -1))
    return np.array(of_each)[inverse]


def _fitting(attempts: pa.ListArray, accepted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each slot has possible attempts: with seed and outcome, finite, and the last one accepted where the slot is. What was
    not read is not judged."""
    flat, rows = attempts.flatten(), parents(attempts)
    good = np.ones(len(accepted), bool)
    names = {field.name for field in flat.type}
    if not len(flat) or not {"outcome", "seed"} <= names:
        return good
    wrong = ~valid(flat.field("outcome")) | ~valid(flat.field("seed"))
    for field in ATTEMPTS:
        if pa.types.is_floating(field.type) and field.name in names:
            wrong |= ~np.isfinite(numbers(flat.field(field.name)))
    good[rows[wrong]] = False
    numbered, outcomes = codes(flat.field("outcome"))
    won = numbered == (outcomes.index("accepted") if "accepted" in outcomes else len(outcomes))
    last = np.append(rows[1:] != rows[:-1], True)
    ends = rows[last]
    good[ends] &= won[last] == accepted[ends]
    return good


class Files:
    """Which episode files a dataset has, from one listing of every cell's directory."""

    def __init__(self, root: os.PathLike[str] | str) -> None:
        self._root = os.fspath(root)
        self._cells: dict[Cell, dict[str, os.DirEntry[str]]] = {}

    def entry(self, slot: Slot) -> os.DirEntry[str] | None:
        """The directory entry of a slot's episode, None if it is missing. A dangling link is returned. Raises OSError."""
        return self._scan(slot.cell).get(f"{episode_name(slot.index, slot.variant)}.hdf5")

    def _scan(self, cell: Cell) -> dict[str, os.DirEntry[str]]:
        if cell not in self._cells:
            try:
                with os.scandir(os.path.join(self._root, cell.path)) as found:
                    self._cells[cell] = {each.name: each for each in found}
            except (FileNotFoundError, NotADirectoryError):
                self._cells[cell] = {}
        return self._cells[cell]

    def listed(self, entries: Entries) -> NDArray[np.bool_]:
        """Of which rows (N,) of some entries the episode is there; a link to nothing is there. Raises OSError."""
        found = [self._scan(cell) for cell in entries.cells]
        return np.array([name in found[rank] for rank, name in zip(entries.ranks.tolist(), _names(entries), strict=True)], bool)

    def there_of(self, entries: Entries, listed: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Of which rows (N,) of some entries that are `listed` the episode is there; a link to nothing is not. Raises OSError."""
        gone = set[tuple[int, str]]()
        for rank, cell in enumerate(entries.cells):
            links = [each for each in self._scan(cell).values() if each.is_symlink()]
            gone |= {(rank, each.name) for each in links if not os.path.exists(each.path)}
        if not gone:
            return listed
        rows = zip(listed.tolist(), entries.ranks.tolist(), _names(entries), strict=True)
        return np.array([found and (rank, name) not in gone for found, rank, name in rows], bool)

    def stamps(self, entries: Entries) -> list[str]:
        """The stamp of every row's episode, "" if the file is missing. Raises OSError."""
        found = [self._scan(cell) for cell in entries.cells]
        files = (found[rank].get(name) for rank, name in zip(entries.ranks.tolist(), _names(entries), strict=True))
        return ["" if file is None else _stamp(file) for file in files]

    def there(self, slot: Slot) -> bool:
        """Whether a slot's episode is there; a link to nothing is not."""
        entry = self.entry(slot)
        return entry is not None and (not entry.is_symlink() or os.path.exists(entry.path))


def _stamp(file: os.DirEntry[str]) -> str:
    try:
        return stamp_of(file.stat())
    except FileNotFoundError:  # a link to nothing
        return ""


def _names(entries: Entries) -> Iterator[str]:
    """The name of every row's episode file."""
    for index, variant in zip(*entries.numbers, strict=True):
        yield f"{episode_name(index, variant)}.hdf5"

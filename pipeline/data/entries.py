"""The ledger as it was at one moment, for the slots of a recipe and in its order: what status, builds, exports and reports read."""

import os
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import product

import numpy as np
import pyarrow as pa
from pyarrow.compute import call_function

from pipeline.data.ledger import ATTEMPTS, SHA256, SlotRecord
from pipeline.data.ledger_files import NO_RECORD, Ledger
from pipeline.data.ledger_table import PLACE, SCHEMA, cell_of, record_of
from pipeline.data.recipe import Recipe, Slot

_OWN = PLACE[:-1]
_ROWS = 1024


class Entries:
    """Some columns of the entries of a recipe's slots, one row each, in the recipe's order. What cannot be (an accepted slot
    without a hash) is left out, and `impossible`: its slot counts as not finished."""

    def __init__(self, ledger: Ledger, recipe: Recipe, columns: Sequence[str] | None = None) -> None:
        wanted = SCHEMA.names if columns is None else list(dict.fromkeys((*PLACE, "accepted", "sha256", *columns)))
        journal = ledger.journal()
        groups = list(product(recipe.tasks, recipe.embodiments))
        table = pa.concat_tables([ledger.table(group, journal, wanted) for group in groups])
        self.table, self.impossible = _in_order(table, recipe)

    @cached_property
    def slots(self) -> list[Slot]:
        """The slot of every row."""
        names = (self.table[name].to_pylist() for name in PLACE)
        return [Slot(cell_of(*cell), index, variant) for *cell, index, variant in zip(*names, strict=True)]

    @cached_property
    def accepted(self) -> list[bool]:
        """Whether every row's slot was accepted."""
        return self.table["accepted"].to_pylist()

    def records(self) -> Iterator[tuple[Slot, SlotRecord | None]]:
        """Every row in full, None for one that is no entry. All columns must have been read."""
        for start in range(0, len(self.table), _ROWS):
            rows = self.table.slice(start, _ROWS).to_pylist()
            for slot, row in zip(self.slots[start : start + _ROWS], rows, strict=True):
                try:
                    yield slot, record_of(row)
                except NO_RECORD:
                    yield slot, None

    def kept(self, mask: Sequence[bool]) -> "Entries":
        """Those rows where the mask is true."""
        less = Entries.__new__(Entries)
        less.table, less.impossible = self.table.filter(pa.array(mask, pa.bool_())), self.impossible
        return less

    def attempts(self) -> pa.Table:
        """All attempts, as a table with the columns ATTEMPTS, those of a slot together. `attempts` must have been read."""
        column = self.table["attempts"].combine_chunks()
        if not len(column):
            return ATTEMPTS.empty_table()
        parents, flat = column.value_parent_indices(), column.flatten()
        arrays = []
        for name in ATTEMPTS.names:
            values = flat.field(name)
            arrays.append(
                call_function("coalesce", [values, self.table[name].take(parents).combine_chunks()]) if name in _OWN else values
            )
        return pa.table(arrays, schema=ATTEMPTS)


def _in_order(table: pa.Table, recipe: Recipe) -> tuple[pa.Table, list[Slot]]:
    """The rows that are entries of the recipe's slots, each slot once, in the recipe's order; and the slots of impossible ones."""
    if not len(table):
        return table, []
    cells = {cell: number for number, cell in enumerate(recipe.counts())}
    names = [table[name].to_pylist() for name in PLACE[:5]]
    ranks = np.array([-1 if None in cell else cells.get(cell_of(*cell), -1) for cell in zip(*names, strict=True)])
    index = table["slot"].fill_null(-1).to_numpy()
    variant = table["variant"].fill_null(-1).to_numpy()
    wanted = np.array(list(recipe.counts().values()))
    known = (ranks >= 0) & (index >= 0) & (index < wanted[ranks]) & (variant >= 0) & (variant < recipe.variants)
    hashes, accepted = table["sha256"].to_pylist(), table["accepted"].fill_null(False).to_numpy()
    hashed = np.array([text is not None and bool(SHA256.fullmatch(text)) for text in hashes])
    empty = np.array([text == "" for text in hashes])
    possible = np.where(accepted, hashed, empty)
    if "attempts" in table.column_names:
        possible &= _fitting(table["attempts"].combine_chunks(), accepted)
    places = zip(*(table[name].filter(pa.array(known & ~possible)).to_pylist() for name in PLACE), strict=True)
    impossible = [Slot(cell_of(*cell), number, look) for *cell, number, look in places]
    known &= possible
    order = np.lexsort((variant, ranks, index))
    order = order[known[order]]
    sorted_places = np.stack([variant, ranks, index])[:, order]
    first = np.ones(len(order), bool)
    first[1:] = (sorted_places[:, 1:] != sorted_places[:, :-1]).any(axis=0)
    return table.take(order[first]).combine_chunks(), impossible


def _fitting(attempts: pa.ListArray, accepted: np.ndarray) -> np.ndarray:
    """Whether each slot has possible attempts: with seed and outcome, finite, and the last one accepted where the slot is."""
    flat, parents = attempts.flatten(), attempts.value_parent_indices().to_numpy()
    good = np.ones(len(accepted), bool)
    if not len(flat):
        return good
    outcomes = flat.field("outcome")
    wrong = (outcomes.is_null().to_numpy(False)) | flat.field("seed").is_null().to_numpy(False)
    for field in ATTEMPTS:
        if pa.types.is_floating(field.type):
            wrong |= ~np.isfinite(flat.field(field.name).fill_null(0.0).to_numpy(False))
    good[parents[wrong]] = False
    won = np.array([outcome == "accepted" for outcome in outcomes.to_pylist()])
    last = np.append(parents[1:] != parents[:-1], True)
    ends = parents[last]
    good[ends] &= won[last] == accepted[ends]
    return good


class Files:
    """Which episode files a dataset has, from one listing of every cell's directory."""

    def __init__(self, root: os.PathLike[str] | str) -> None:
        self._root = os.fspath(root)
        self._folders: dict[str, dict[str, os.DirEntry[str]]] = {}

    def entry(self, slot: Slot) -> os.DirEntry[str] | None:
        """The directory entry of a slot's episode, None where nothing is there. A link to nothing is there. Raises OSError."""
        folder, _, name = slot.path.rpartition("/")
        if folder not in self._folders:
            try:
                with os.scandir(os.path.join(self._root, folder)) as found:
                    self._folders[folder] = {each.name: each for each in found}
            except (FileNotFoundError, NotADirectoryError):
                self._folders[folder] = {}
        return self._folders[folder].get(f"{name}.hdf5")

    def there(self, slot: Slot) -> bool:
        """Whether a slot's episode is there; a link to nothing is not."""
        entry = self.entry(slot)
        return entry is not None and (not entry.is_symlink() or os.path.exists(entry.path))

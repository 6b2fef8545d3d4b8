"""Slots that an index holds, as columns, and which of their files are there."""

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.recipe.cells import Cell, Slot, episode_name
from pipeline.data.recipe.model import Recipe
from pipeline.data.store.place import place_of


@dataclass(frozen=True, eq=False)
class Rows:
    """Slots of a recipe that the index holds, in the recipe's order, as columns (N,).

    `ids` are their numbers in the index, `ranks` those of their cells among `cells`; `keys` are
    numbers of `texts`, packed as `pack_keys` does. `more` has the columns that were asked for
    besides.
    """

    cells: Sequence[Cell]
    ids: NDArray[np.int64]
    ranks: NDArray[np.int64]
    index: NDArray[np.int64]
    variants: NDArray[np.int64]
    accepted: NDArray[np.bool_]
    keys: NDArray[np.int64]
    texts: dict[int, str] = field(default_factory=dict[int, str])
    more: dict[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def slots(self) -> list[Slot]:
        """The slot of every row."""
        rows = zip(self.ranks.tolist(), self.index.tolist(), self.variants.tolist(), strict=True)
        return [Slot(self.cells[rank], index, variant) for rank, index, variant in rows]

    def where(self, chosen: NDArray[Any]) -> "Rows":
        """Some of the rows, by a mask (N,) or by their numbers."""
        columns = {
            name: getattr(self, name)[chosen]
            for name in ("ids", "ranks", "index", "variants", "accepted", "keys")
        }
        return replace(
            self, **columns, more={name: values[chosen] for name, values in self.more.items()}
        )


EPISODE, GIVEN_UP = ".hdf5", ".given_up.json"
"""How the names of the files of slots end: of an accepted one, and of one that was given up."""

_FILE = re.compile(r"episode_(\d{7,8})(?:_v(\d+))?(\.hdf5|\.given_up\.json)")


class Listing:
    """Which files of slots there are below a directory, from one listing of the directory of every
    cell of a recipe."""

    def __init__(self, root: Path, recipe: Recipe) -> None:
        self._recipe = recipe
        self._files = [_list_files(root / cell.path) for cell in recipe.cells()]
        if place := place_of(root):
            on_store = place.sizes()
            for cell, files in zip(recipe.cells(), self._files, strict=True):
                there = on_store.get(str(root / cell.path), {})
                files |= {name: size for name, size in there.items() if name not in files}

    def there(self, rows: Rows) -> NDArray[np.bool_]:
        """Of which rows (N,) the file is there."""
        return np.array(
            [
                name in self._files[rank]
                for rank, name in zip(rows.ranks.tolist(), _names(rows), strict=True)
            ],
            bool,
        )

    def states(self, rows: Rows) -> NDArray[np.int64]:
        """Size in bytes and time of change in ns (N,2) of the file of every row, -1 if it is
        missing. The time is 0 of a file that is on a store only. Raises OSError."""
        files = (
            self._files[rank].get(name)
            for rank, name in zip(rows.ranks.tolist(), _names(rows), strict=True)
        )
        return np.array([_state(file) for file in files], np.int64).reshape(-1, 2)

    def unknown(self, rows: Rows) -> Iterator[tuple[Slot, bool]]:
        """Slots of the recipe that have a file and no row, and whether it is an episode. A note
        that a slot was given up is none beside an episode: that was written later."""
        known = [set[str]() for _ in self._files]
        for rank, name in zip(rows.ranks.tolist(), _names(rows), strict=True):
            known[rank].add(name)
        for (cell, count), files, mine in zip(
            self._recipe.counts().items(), self._files, known, strict=True
        ):
            for name in sorted(files.keys() - mine):
                found = _FILE.fullmatch(name)
                if found is None or (
                    found[3] == GIVEN_UP and name.replace(GIVEN_UP, EPISODE) in files
                ):
                    continue
                slot = Slot(cell, int(found[1]), int(found[2] or 0))
                if (
                    slot.index < count
                    and slot.variant < self._recipe.variants
                    and name == file_name(slot, found[3] == EPISODE)
                ):
                    yield slot, found[3] == EPISODE


def find_slot(recipe: Recipe, path: str) -> Slot | None:
    """The slot of a recipe whose file is at a path below `episodes/`, without its suffix; None if
    there is none."""
    folder, _, name = path.rpartition("/")
    found = _FILE.fullmatch(f"{name}{EPISODE}")
    for cell, count in recipe.counts().items() if found else ():
        if cell.path == folder and found:
            slot = Slot(cell, int(found[1]), int(found[2] or 0))
            return (
                slot
                if slot.index < count and slot.variant < recipe.variants and slot.path == path
                else None
            )
    return None


def file_name(slot: Slot, accepted: bool) -> str:
    """The name of the file of a slot that was accepted or given up."""
    return f"{episode_name(slot.index, slot.variant)}{EPISODE if accepted else GIVEN_UP}"


def _list_files(folder: Path) -> dict[str, os.DirEntry[str] | int]:
    try:
        with os.scandir(folder) as found:
            return {each.name: each for each in found if each.is_file()}
    except (FileNotFoundError, NotADirectoryError):
        return {}


def _state(file: os.DirEntry[str] | int | None) -> tuple[int, int]:
    if file is None or isinstance(file, int):
        return (-1, -1) if file is None else (file, 0)
    try:
        state = file.stat()
    except FileNotFoundError:
        return -1, -1
    return state.st_size, state.st_mtime_ns


def _names(rows: Rows) -> Iterator[str]:
    """The name of every row's file."""
    for index, variant, accepted in zip(
        rows.index.tolist(), rows.variants.tolist(), rows.accepted.tolist(), strict=True
    ):
        yield f"{episode_name(index, variant)}{EPISODE if accepted else GIVEN_UP}"

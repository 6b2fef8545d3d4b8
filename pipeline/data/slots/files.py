"""The files of a dataset, and which indexed ones exist."""

import json
import os
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.atomic import write_atomic
from pipeline.data.keys import SlotKeys, canonical, file_hash
from pipeline.data.names import MANIFEST
from pipeline.data.parsing import parse_json
from pipeline.data.reading import read_regular
from pipeline.data.recipe.cells import Cell, Slot, episode_name
from pipeline.data.recipe.model import Recipe
from pipeline.data.store.place import place_of, put
from pipeline.poses import Bools, Ints

from .records import FileFacts, SlotRecord, untimed

EPISODE, GIVEN_UP = ".hdf5", ".given_up.json"  # how files of slots end

_FILE = re.compile(r"episode_(\d{7,8})(?:_v(\d+))?(\.hdf5|\.given_up\.json)")


class Paths:
    """The paths of a dataset. `orphans` has whole episodes of no slot that `gc` moved."""

    def __init__(self, root: Path) -> None:
        self.root = root = Path(root)
        self.manifest = root / MANIFEST
        self.index = root / "index.sqlite"
        self.attempts = root / "attempts.parquet"
        self.provenance = root / "provenance.json"
        self.report = root / "report" / "index.html"
        self.assets = root / "assets"
        self.bodies = self.assets / "bodies"
        self.episodes = root / "episodes"
        self.failures = root / "failures"
        self.orphans = root / "orphans"

    def episode(self, slot: Slot) -> Path:
        return self.episodes / f"{slot.path}{EPISODE}"

    def file(self, slot: Slot, accepted: bool) -> Path:
        """Its episode, or the note that it was given up."""
        return self.episodes / f"{slot.path}{EPISODE if accepted else GIVEN_UP}"

    def failure(self, slot: Slot, attempt: int) -> Path:
        return self.failures / f"{slot.path}_attempt_{attempt:03d}{EPISODE}"

    def log(self, slot: Slot) -> Path:
        return self.root / "logs" / f"{slot.path}.log"

    def exports(self, name: str) -> Path:
        return self.root / "exports" / name


@dataclass(frozen=True, eq=False)
class Rows:
    """Slots of a recipe that the index holds, in its order, as columns (N,): `ids`, `ranks` of
    cells, `keys` of `texts`, and `more`.
    """

    cells: Sequence[Cell]
    ids: Ints
    ranks: Ints
    index: Ints
    variants: Ints
    accepted: Bools
    keys: Ints
    texts: dict[int, str] = field(default_factory=dict[int, str])
    more: dict[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def slots(self) -> list[Slot]:
        rows = zip(self.ranks.tolist(), self.index.tolist(), self.variants.tolist(), strict=True)
        return [Slot(self.cells[rank], index, variant) for rank, index, variant in rows]

    @cached_property
    def names(self) -> list[tuple[int, str]]:
        """The rank of every row's cell, and the name of its file in that directory."""
        columns = (self.ranks, self.index, self.variants, self.accepted)
        return [
            (rank, f"{episode_name(index, variant)}{EPISODE if accepted else GIVEN_UP}")
            for rank, index, variant, accepted in zip(*(c.tolist() for c in columns), strict=True)
        ]

    def where(self, chosen: NDArray[Any]) -> "Rows":
        """Some rows, by a mask (N,) or by numbers."""
        columns = {
            name: getattr(self, name)[chosen]
            for name in ("ids", "ranks", "index", "variants", "accepted", "keys")
        }
        more = {name: values[chosen] for name, values in self.more.items()}
        return replace(self, **columns, more=more)


class Listing:
    """Which files of slots are below a directory, from one listing of each cell's."""

    def __init__(self, root: Path, recipe: Recipe) -> None:
        self._recipe, place = recipe, place_of(root)
        there = defaultdict[str, dict[str, int]](dict)  # on a store, by directory
        for name, size in place.sizes().items() if place else ():
            folder, _, file = name.rpartition("/")
            there[folder][file] = size
        self._files = list[dict[str, os.DirEntry[str] | int]]()
        for cell in recipe.counts():
            folder = root / cell.path
            files = dict[str, os.DirEntry[str] | int]()
            if place:
                files |= there[place.name(folder)]
            try:
                with os.scandir(folder) as found:
                    files |= {each.name: each for each in found if each.is_file()}
            except (FileNotFoundError, NotADirectoryError):
                pass
            self._files.append(files)

    def there(self, rows: Rows) -> Bools:
        """Of which rows (N,) the file is there."""
        return np.array([name in self._files[rank] for rank, name in rows.names], bool)

    def states(self, rows: Rows) -> Ints:
        """Size (bytes) and change time (ns) of rows' files (N,2), -1 if missing. Raises OSError."""
        found = np.full((len(rows), 2), -1, np.int64)
        for number, (rank, name) in enumerate(rows.names):
            file = self._files[rank].get(name)
            try:
                if isinstance(file, int):
                    found[number] = file, 0
                elif file is not None:
                    found[number] = file.stat().st_size, file.stat().st_mtime_ns
            except FileNotFoundError:
                continue
        return found

    def unknown(self, rows: Rows) -> Iterator[tuple[Slot, bool]]:
        """Slots with a file and no row, and whether it is an episode, whose note does not count."""
        known = [set[str]() for _ in self._files]
        for rank, name in rows.names:
            known[rank].add(name)
        counts = self._recipe.counts().items()
        for (cell, count), files, mine in zip(counts, self._files, known, strict=True):
            for name in sorted(files.keys() - mine):
                slot, accepted = _slot_in(self._recipe, cell, count, name), name.endswith(EPISODE)
                if slot and (accepted or name.replace(GIVEN_UP, EPISODE) not in files):
                    yield slot, accepted


def find_slot(recipe: Recipe, path: str) -> Slot | None:
    """The slot whose episode is at a path below `episodes/`, without suffix."""
    folder, _, name = path.rpartition("/")
    cells = ((cell, count) for cell, count in recipe.counts().items() if cell.path == folder)
    return next((_slot_in(recipe, *cell, f"{name}{EPISODE}") for cell in cells), None)


def _slot_in(recipe: Recipe, cell: Cell, count: int, name: str) -> Slot | None:
    """The slot of a cell with this file name, if any."""
    if not (found := _FILE.fullmatch(name)):
        return None
    slot = Slot(cell, int(found[1]), int(found[2] or 0))
    own = slot.index < count and slot.variant < recipe.variants
    return slot if own and name == episode_name(slot.index, slot.variant) + found[3] else None


def write_given_up(
    dataset: Paths, slot: Slot, keys: SlotKeys, attempts: Sequence[Mapping[str, Any]]
) -> SlotRecord:
    """Write the note that a slot was given up; its record. Raises OSError."""
    path = dataset.file(slot, False)
    values = {"slot": slot.path, "keys": keys.to_json(), "attempts": untimed(attempts)}
    write_atomic(path, json.dumps(values, sort_keys=True, indent=1).encode() + b"\n")
    put(path)
    rows, facts = tuple(map(dict, attempts)), FileFacts.of(path.stat())
    return SlotRecord(keys, False, file_hash(path), rows, file=facts)


def read_given_up(path: Path, slot: str) -> tuple[SlotKeys, list[dict[str, Any]]]:
    """Keys and attempts of a given-up note. Raises OSError, ValueError, KeyError, TypeError or
    AttributeError.
    """
    values = parse_json(read_regular(path))
    canonical(values)  # refuses texts that have no UTF-8
    attempts = [dict(row) for row in values["attempts"]]
    if values["slot"] != slot or any(row["outcome"] == "accepted" for row in attempts):
        raise ValueError("is not the note that this slot was given up")
    return SlotKeys.from_json(values["keys"]), attempts

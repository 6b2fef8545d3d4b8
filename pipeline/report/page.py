"""The report of a dataset as it is now: outcomes and films, and what the annotations see where there are any."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.data.atomic import atomic_path
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError
from pipeline.data.keys import digest, file_hash
from pipeline.data.ledger.columns import rows_of
from pipeline.data.ledger.entries import Entries
from pipeline.data.spec import EpisodeSpec
from pipeline.report.contact_sheet import encode
from pipeline.report.sections import Figure, Section, Strip
from pipeline.report.summary import Cell, Material, Observation, observe, write_report

type SheetOf = Callable[[Path, Path], NDArray[np.uint8] | None]
"""(dataset directory, episode relative to episodes/) -> image (H,W,3) uint8 RGB of its annotations, or None where it has none."""

SHEETS = 12
"""Annotation sheets shown at most; one episode of a cell."""


def refresh(dataset: Dataset, sheet_of: SheetOf) -> Path:
    """Update the report, with annotations as `sheet_of` draws them, and return the path of its first page.

    Figures come from the ledger. Only the episodes that are shown are opened, and variants, whose entries have no figures of
    motions. An episode that cannot be read is left out; `domino-data verify` names it. Raises DatasetError for a directory without
    a recipe.
    """
    recipe = dataset.recipe()
    entries = dataset.present(dataset.entries(recipe, ("attempts", "frames")))
    table = entries.attempts()
    with atomic_path(dataset.attempts) as temporary:
        pq.write_table(table, temporary, compression="zstd")
    seen = list(_observe(dataset, entries, recipe.fps))
    keys = {task: _key(dataset, task, recipe.embodiments) for task in recipe.tasks}
    return write_report(
        dataset.root, Material(seen, CellRows(table), keys), _annotations(dataset, dataset.accepted(recipe), sheet_of)
    )


def _observe(dataset: Dataset, entries: Entries, fps: int) -> Iterator[Observation]:
    """The accepted episodes, by their entries."""
    rows = zip(entries.slots, entries.table["frames"].to_pylist(), _motions(entries), strict=True)
    for slot, frames, motion in rows:
        if motion is None:
            continue
        path, cell, (seed, average, maximum) = dataset.episode(slot), slot.cell, motion
        if frames and average is not None and maximum is not None:
            spec = EpisodeSpec(cell.task, cell.embodiment, cell.level, cell.alpha, cell.domain, slot.index, seed)
            yield Observation(path, spec, frames / fps, average, maximum)
        else:
            with suppress(EpisodeError, KeyError, OSError, ValueError):
                yield observe(path)


def _motions(entries: Entries) -> Iterator[tuple[int, float | None, float | None] | None]:
    """Of every entry the seed of its accepted attempt and the speeds of its motion (m/s); None if it was given up. Variants
    have no attempts of their own, and no speeds."""
    tried = entries.table["attempts"].combine_chunks()
    names = ("seed", "average_speed", "maximum_speed")
    values = list(zip(*(tried.flatten().field(name).to_pylist() for name in names), strict=True))
    end = 0
    for accepted, length in zip(entries.accepted, tried.value_lengths().to_pylist(), strict=True):
        end += length
        yield (values[end - 1] if length else (0, None, None)) if accepted else None


class CellRows(Mapping[Cell, list[dict[str, Any]]]):
    """The attempts of every cell, of a table with the columns ATTEMPTS; the rows of a cell are made when they are asked for."""

    def __init__(self, table: pa.Table) -> None:
        names = ("task", "embodiment", "level", "alpha", "domain")
        rows = defaultdict[Cell, list[int]](list)
        for number, cell in enumerate(zip(*(table[name].to_pylist() for name in names), strict=True)):
            rows[cell].append(number)
        self._table, self._rows = table, rows

    def __getitem__(self, cell: Cell) -> list[dict[str, Any]]:
        if cell not in self._rows:
            raise KeyError(cell)
        return self._table.take(rows_of(np.array(self._rows[cell]))).to_pylist()

    def __iter__(self) -> Iterator[Cell]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)


def _key(dataset: Dataset, task: str, robots: Sequence[str]) -> str:
    """What the page of a task is made of: its ledger, and the pictures of its failed attempts."""
    files = [dataset.ledger.file((task, robot)) for robot in robots]
    failed = sorted(p.name for p in (dataset.root / "report" / "failed" / task).rglob("*.jpg"))
    return digest([[file_hash(path) if path.is_file() else "" for path in files], failed])


def _annotations(dataset: Dataset, episodes: list[Path], sheet_of: SheetOf) -> list[Section]:
    if not (dataset.root / "annotations").is_dir():
        return []
    first_of_cell = {path.parent: path for path in reversed(episodes)}
    strips = []
    for path in list(reversed(first_of_cell.values()))[:SHEETS]:
        relative = path.relative_to(dataset.episodes)
        sheet = sheet_of(dataset.root, relative)
        if sheet is not None:
            strips.append(Strip([Figure(encode(sheet, quality=85), str(relative.with_suffix("")))], 1))
    return [Section("Annotations", strips)] if strips else []

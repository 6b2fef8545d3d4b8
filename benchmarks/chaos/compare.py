"""Two datasets of one recipe, compared byte by byte but for what was measured (seconds, times of
change, the report's figures)."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from pipeline.data.dataset import Dataset
from pipeline.data.keys import file_hash

APART = ("attempts.parquet", "index.sqlite", "report")
"""What holds measured seconds: compared by content, the report only by being there."""


@dataclass(frozen=True)
class RunComparison:
    """The differences of two datasets: files that only one has, files and entries that differ, and
    the number of equal files.

    Slots of the reference that are missing are `lost`."""

    slots: int
    same: int
    lost: list[str]
    left_over: list[str]
    missing: list[str]
    different: list[str]

    @property
    def identical(self) -> bool:
        """Whether there is no difference."""
        return not (self.lost or self.left_over or self.missing or self.different)


def compare(reference: Path, other: Path) -> RunComparison:
    """Compare two finished datasets."""
    first, second = _files(reference), _files(other)
    both = [name for name in first if name in second]
    plain = [name for name in both if Path(name).parts[0] not in APART]
    different = [name for name in plain if file_hash(reference / name) != file_hash(other / name)]
    entries, others = _entries(reference), _entries(other)
    different += [
        f"record of {slot}" for slot in entries if slot in others and entries[slot] != others[slot]
    ]
    if _attempts(reference) != _attempts(other):
        different.append("attempts.parquet")
    return RunComparison(
        slots=len(entries),
        same=len(plain) - sum(name in plain for name in different),
        lost=[slot for slot in entries if slot not in others],
        left_over=[name for name in second if name not in first],
        missing=[name for name in first if name not in second],
        different=different,
    )


def _files(root: Path) -> list[str]:
    """All files but the report's pages and pictures, and logs. Which failed attempt a cell's
    picture shows depends on which came first; a worker that was killed leaves its log."""
    found = sorted(
        path.relative_to(root).as_posix() for path in root.rglob("*") if not path.is_dir()
    )
    return [
        name
        for name in found
        if not name.startswith(("report/", "logs/")) or name == "report/index.html"
    ]


def _entries(root: Path) -> dict[str, Any]:
    found, dataset = {}, Dataset(root)
    for slot, record in dataset.records(dataset.recipe()):
        rows = tuple(
            {name: value for name, value in row.items() if name != "seconds"}
            for row in record.attempts
        )
        found[slot.path] = replace(
            record,
            attempts=rows,
            seconds=0.0,
            core_seconds=0.0,
            file=replace(record.file, changed=0),
        )
    return found


def _attempts(root: Path) -> list[dict[str, Any]]:
    return pq.read_table(root / "attempts.parquet").drop_columns("seconds").to_pylist()

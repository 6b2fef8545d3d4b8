"""Episodes of several datasets in one directory, for an export."""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.data.dataset import Dataset
from pipeline.export import ExportError


@dataclass(frozen=True)
class DatasetPart:
    """A dataset, and those of its episodes that are exported, in order."""

    dataset: Dataset
    episodes: Sequence[Path]


def join(sources: Sequence[DatasetPart], root: Path) -> dict[Path, Path]:
    """Hard links to the episodes, or copies, in `root` below the name of their dataset, by
    original. Raises ExportError for two datasets of one name.
    """
    names = [source.dataset.root.resolve().name for source in sources]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ExportError(
            f"two datasets have the name {min(twice)!r}, which tells them apart: rename one"
        )
    made = dict[Path, Path]()
    for source, name in zip(sources, names, strict=True):
        for path in source.episodes:
            place = root / name / path.relative_to(source.dataset.root)
            place.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(path, place)
            except OSError:  # another file system, or one without hard links
                shutil.copy2(path, place)
            made[place] = path
    return made

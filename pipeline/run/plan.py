"""`domino-data plan`: what a recipe asks for, what exists, and what the rest costs. Writes
nothing."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.hdf5 import open_hdf5
from pipeline.data.errors import DominoError
from pipeline.data.recipe.growth import differences
from pipeline.data.recipe.model import Cell, Recipe, Slot
from pipeline.data.slots.files import Listing
from pipeline.data.slots.records import sum_phases
from pipeline.planning.warm import warm_up
from pipeline.run.cost_model import bytes_of, estimate, seconds_of
from pipeline.run.identity.slot_keys import code_version
from pipeline.run.slot.fill import FillJob, fill_slot
from pipeline.run.state import PHYSICS, redo_rows, redone
from pipeline.world.drawing.vulkan import ensure_renderer

SENSORS = {
    "rgb": "images",
    "depth": "depth",
    "actor_segmentation": "segmentation",
    "pointcloud": "point clouds",
}
"""Parts of a file by the names of their datasets; all others are states."""

STATES = "states"


def parts_of(path: Path) -> dict[str, int]:
    """Bytes of an episode file by part; their sum is its size. Raises OSError."""
    sizes = Counter[str]()

    def add(name: str, item: h5py.Group | h5py.Dataset) -> None:
        part = SENSORS.get(name.rpartition("/")[2])
        if part and isinstance(item, h5py.Dataset):
            sizes[part] += item.id.get_storage_size()

    try:
        with open_hdf5(path) as file:
            file.visititems(add)
    except (RuntimeError, KeyError, ValueError) as error:  # what h5py makes of damaged metadata
        raise OSError(f"{path}: {error}") from error
    return dict(sizes) | {STATES: path.stat().st_size - sizes.total()}


def mean_parts(paths: Iterable[Path]) -> dict[str, float]:
    """Mean bytes of an episode by part, over those of the files that can be read."""
    files = list[dict[str, int]]()
    for path in paths:
        try:
            files.append(parts_of(path))
        except OSError:
            continue
    names = [name for name in (*SENSORS.values(), STATES) if any(name in parts for parts in files)]
    return {name: sum(parts.get(name, 0) for parts in files) / len(files) for name in names}


def format_size(size: float) -> str:
    """A number of bytes in words."""
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{max(1, round(size / 1e6))} MB"


def format_hours(hours: float) -> str:
    """A time in words."""
    return f"{hours:.1f} h" if hours >= 1.5 else f"{max(1, round(60 * hours))} min"


# slots that a measurement makes, besides the first, which pays for what is loaded once
MEASURED = 3
JUDGED_BY = 2000  # finished episodes of a dataset whose times and sizes stand for all
LOOKED_AT = 20  # episode files of a dataset that are opened at most to see what their bytes are


@dataclass(frozen=True)
class EpisodeCost:
    """Seconds and bytes that an episode takes, failed attempts included, and the `source` of the
    figures; `core_seconds` and `parts` where they are known."""

    seconds: float
    size: float
    source: str
    core_seconds: float | None = None
    parts: Mapping[str, float] = field(default_factory=dict)

    def core_hours(self, episodes: int) -> float:
        """Processor time of so many episodes."""
        return episodes * (self.seconds if self.core_seconds is None else self.core_seconds) / 3600

    def describe(self, episodes: int, workers: int) -> str:
        """About how long and how much, in words."""
        if not episodes:
            return "nothing is left to make"
        hours, most = estimate(episodes, self.seconds, workers)
        return (
            f"{format_hours(hours)} to {format_hours(most)} on {workers}"
            f" worker{'' if workers == 1 else 's'} and {format_size(episodes * self.size)}"
            f" (estimated from {self.source})"
        )


def typical(recipe: Recipe, source: str = "benchmarks") -> EpisodeCost:
    """What an episode takes by its recipe alone (run/cost_model.py)."""
    parts = bytes_of(recipe)
    return EpisodeCost(seconds_of(recipe), sum(parts.values()), source, parts=parts)


def cost_of(dataset: Dataset | None, recipe: Recipe) -> EpisodeCost:
    """What the finished episodes of a dataset took, by at most JUDGED_BY of them, or `typical`."""
    if dataset is None or not dataset.manifest.exists():
        return typical(recipe)
    rows = dataset.present(recipe, "size", "seconds", "core_seconds")
    rows = rows.where(rows.accepted)
    rows = rows.where(_spread(len(rows), JUDGED_BY))
    if not len(rows):
        return typical(recipe)
    of, tried = dataset.ask(lambda index: index.attempts(rows, "seconds"))
    spent = np.bincount(of, [seconds or 0.0 for (seconds,) in tried], len(rows))
    parts = mean_parts(
        dataset.episode(slot) for slot in rows.where(_spread(len(rows), LOOKED_AT)).slots
    )
    size = float(np.mean(rows.more["size"]))
    return EpisodeCost(
        float(np.mean(np.where(spent, spent, rows.more["seconds"]))),
        size,
        "this dataset",
        _mean_core(rows.more["core_seconds"].tolist()),
        # of fewer files, so in their proportions
        {name: size * part / sum(parts.values()) for name, part in parts.items()},
    )


def _spread(count: int, most: int) -> NDArray[np.bool_]:
    """Which of so many (N,) are looked at, at most `most`, evenly among them."""
    chosen = np.zeros(count, bool)
    chosen[np.linspace(0, max(count - 1, 0), min(count, most)).round().astype(int)] = True
    return chosen


def _mean_core(cores: Sequence[float]) -> float | None:
    """Mean processor time, where it is known of all."""
    return float(np.mean(cores)) if all(cores) else None


def measure(recipe: Recipe) -> EpisodeCost:
    """Make a few episodes of cells that are spread over the recipe's, in a temporary directory, and
    measure their cost. Raises NoRenderer."""
    ensure_renderer()
    recipe = recipe.model_copy(update={"variants": 1})
    cells = [cell for cell, count in recipe.counts().items() if count]
    picked = [cells[int(i)] for i in np.linspace(0, len(cells) - 1, MEASURED).round()]
    slots = list(
        dict.fromkeys([Slot(picked[0], 0), *(Slot(cell, 1 + i) for i, cell in enumerate(picked))])
    )
    warm_up(slots[0].cell.embodiment)
    with TemporaryDirectory(prefix="domino-plan-") as folder:
        dataset = Dataset(Path(folder) / "dataset")
        dataset.create(recipe)
        made = [
            (slot, fill_slot(FillJob(str(dataset.root), recipe, slot, code_version())))
            for slot in slots
        ]
        accepted = {slot: record for slot, record in made[1:] if record.accepted}
        if not accepted:
            return typical(recipe, "benchmarks: no measured attempt was accepted")
        return EpisodeCost(
            float(
                np.mean(
                    [sum(row["seconds"] for row in record.attempts) for record in accepted.values()]
                )
            ),
            float(np.mean([record.file.size for record in accepted.values()])),
            f"{len(accepted)} episodes measured now",
            _mean_core([sum_phases(record.phases)[1] for record in accepted.values()]),
            mean_parts(dataset.episode(slot) for slot in accepted),
        )


BOUNDS = ("tasks", "levels", "episodes", "total")
"""Keys of a recipe that bound a build's length."""


class Unbounded(DominoError):
    """A build without a bound; the message names what it would make and the options that choose."""


def check_bounded(given: Collection[str], recipe: Recipe, dataset: Dataset, workers: int) -> None:
    """Raise Unbounded for a new dataset of a recipe of whose BOUNDS none is `given`."""
    if any(key in given for key in BOUNDS) or dataset.manifest.exists():
        return
    values = plan(recipe, None, workers)
    raise Unbounded(
        f"this build would make {values['slots']:,} episodes, {values['estimate']}: choose with"
        f" {', '.join(f'--{key}' for key in BOUNDS)} or --manifest (for example --tasks click_bell"
        " --episodes 2), or add --yes"
    )


def plan(
    recipe: Recipe,
    dataset: Dataset | None,
    workers: int,
    cost: EpisodeCost | None = None,
    price: float | None = None,
) -> dict[str, Any]:
    """The work that is left: cells with wanted and finished slots; parts to make again (`redo`);
    estimated hours, core-hours, their price at `price` each, and bytes.

    The estimate follows from `cost`, by default the dataset's. Raises DatasetError for a dataset of
    another recipe."""
    done, redo = Counter[Cell](), Counter[tuple[str, tuple[str, ...]]]()
    if dataset is not None and dataset.manifest.exists():
        if changed := differences(dataset.recipe(), recipe):
            raise DatasetError(
                f"{dataset.root} holds another recipe, which `build` refuses to change:"
                f" {'; '.join(changed)}"
            )
        rows = dataset.rows(recipe)
        there = Listing(dataset.episodes, recipe).there(rows)
        redo = redone(recipe, rows.where(there), there[there])
        done = Counter(slot.cell for slot in rows.where(there).slots)
    cost = cost or cost_of(dataset, recipe)
    cells = [
        asdict(c) | {"episodes": count * recipe.variants, "finished": done[c]}
        for c, count in recipe.counts().items()
    ]
    slots = sum(c["episodes"] for c in cells)
    left = slots - done.total() + sum(count for (what, _), count in redo.items() if what == PHYSICS)
    hours, most = estimate(left, cost.seconds, workers)
    return {
        "cells": cells,
        "slots": slots,
        "finished": done.total(),
        "redo": redo_rows(redo),
        "workers": workers,
        "estimated_hours": hours,
        "estimated_hours_most": most,
        "estimated_core_hours": cost.core_hours(left),
        "estimated_cost": None if price is None else cost.core_hours(left) * price,
        "estimated_bytes": int(left * cost.size),
        "estimated_bytes_by_part": {name: int(left * size) for name, size in cost.parts.items()},
        "estimate_from": cost.source,
        "estimate": cost.describe(left, workers),
    }

"""What an episode costs in seconds and bytes: as a dataset's own record says, as measured here, or as benchmarks say."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pipeline.data.dataset import Dataset
from pipeline.data.ledger import SlotRecord
from pipeline.data.recipe import Recipe, Slot
from pipeline.planning.warm import warm_up
from pipeline.run import sizes
from pipeline.run.keys import code_version
from pipeline.run.slot import SlotJob, fill_slot
from pipeline.world.robots.mesh_store import copy_meshes, find_meshes
from pipeline.world.vulkan import ensure_renderer

SECONDS_PER_EPISODE = 5.0
"""Core seconds of an accepted episode at 320x240 in the `raster` preset, where nothing was measured (README)."""

BYTES_PER_EPISODE = 3.5e6

MEASURED = 3
"""Slots that a measurement makes, besides the first, which pays for what is loaded once."""


LOOKED_AT = 20
"""Episode files of a dataset that are opened at most to see what their bytes are."""


@dataclass(frozen=True)
class Cost:
    """Seconds and bytes that an episode takes, failed attempts included, and where the figures come from.

    `core_seconds` is processor time, where it is known; `parts` the bytes by part (run/sizes.py), where files were looked at.
    """

    seconds: float
    size: float
    source: str
    core_seconds: float | None = None
    parts: Mapping[str, float] = field(default_factory=dict)

    def core_hours(self, episodes: int) -> float:
        """Processor time of so many episodes."""
        return episodes * (self.seconds if self.core_seconds is None else self.core_seconds) / 3600

    def hours(self, episodes: int, workers: int) -> float:
        """How long so many workers take that each have a core."""
        return episodes * self.seconds / 3600 / workers

    def said(self, episodes: int, workers: int) -> str:
        """About how long and how much, in words."""
        minutes = 60 * self.hours(episodes, workers)
        time = f"{minutes / 60:.1f} h" if minutes >= 90 else f"{max(1, round(minutes))} min"
        amount = sizes.said(episodes * self.size)
        return f"about {time} on {workers} worker{'' if workers == 1 else 's'} and {amount} (from {self.source})"


def cost_of(dataset: Dataset | None, recipe: Recipe) -> Cost:
    """What the finished episodes of a dataset took; figures of the benchmarks where there is none."""
    records = dict(dataset.records(recipe)) if dataset is not None and dataset.manifest.exists() else {}
    accepted = {slot: record for slot, record in records.items() if record.accepted}
    if dataset is None or not accepted:
        return Cost(SECONDS_PER_EPISODE, BYTES_PER_EPISODE, "benchmarks")
    return _mean(dataset, accepted.items(), "this dataset")


def measure(recipe: Recipe, assets: Path | None = None) -> Cost:
    """Make a few episodes of the recipe in a temporary directory, one after another in this process, and say what they took.

    The cells are spread evenly over the recipe's. Raises NoRenderer without Vulkan, VendorMeshError for meshes that are missing.
    """
    ensure_renderer()
    recipe = recipe.model_copy(update={"variants": 1})
    cells = [cell for cell, count in recipe.counts().items() if count]
    picked = [cells[int(i)] for i in np.linspace(0, len(cells) - 1, MEASURED).round()]
    slots = list(dict.fromkeys([Slot(picked[0], 0), *(Slot(cell, 1 + i) for i, cell in enumerate(picked))]))
    warm_up(slots[0].cell.embodiment)
    with TemporaryDirectory(prefix="domino-plan-") as folder:
        dataset = Dataset(Path(folder) / "dataset")
        dataset.create(recipe)
        copy_meshes(find_meshes(recipe.robot_meshes, [assets] if assets else []), dataset.assets)
        made = [(slot, fill_slot(SlotJob(str(dataset.root), recipe, slot, code_version()))) for slot in slots]
        accepted = [(slot, record) for slot, record in made[1:] if record.accepted]
        if not accepted:
            return Cost(SECONDS_PER_EPISODE, BYTES_PER_EPISODE, "benchmarks: no measured attempt was accepted")
        return _mean(dataset, accepted, f"{len(accepted)} episodes measured now")


def _mean(dataset: Dataset, accepted: Iterable[tuple[Slot, SlotRecord]], source: str) -> Cost:
    pairs = list(accepted)
    seconds = [_seconds(record) for _, record in pairs]
    bytes_each = [dataset.episode(slot).stat().st_size for slot, _ in pairs]
    cores = [_core_seconds(record) for _, record in pairs]
    known = [value for value in cores if value]
    few = [pairs[int(i)][0] for i in np.unique(np.linspace(0, len(pairs) - 1, LOOKED_AT).round())]
    parts = sizes.mean_parts(dataset.episode(slot) for slot in few)
    core_seconds = float(np.mean(known)) if len(known) == len(pairs) else None
    return Cost(float(np.mean(seconds)), float(np.mean(bytes_each)), source, core_seconds, parts)


def _core_seconds(record: SlotRecord) -> float:
    """Processor time of an episode by its phases."""
    return sum(seconds for name, seconds in record.phases.items() if name.endswith(".cpu"))


def _seconds(record: SlotRecord) -> float:
    """What an episode took: all its attempts, or only the drawing where it shows the physics of another."""
    drawing = sum(seconds for name, seconds in record.phases.items() if not name.endswith(".cpu"))
    return sum(row["seconds"] for row in record.attempts) or drawing

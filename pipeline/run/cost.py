"""What an episode costs in seconds and bytes: as a dataset's own record says, as measured here, or as benchmarks say."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pipeline.data.dataset import Dataset
from pipeline.data.ledger import SlotRecord
from pipeline.data.recipe import Recipe, Slot
from pipeline.planning.warm import warm_up
from pipeline.run.keys import code_version
from pipeline.run.slot import SlotJob, fill_slot
from pipeline.world.robots.mesh_store import copy_meshes, find_meshes
from pipeline.world.vulkan import ensure_renderer

SECONDS_PER_EPISODE = 5.0
"""Core seconds of an accepted episode at 320x240 in the `raster` preset, where nothing was measured (README)."""

BYTES_PER_EPISODE = 3.5e6

MEASURED = 3
"""Slots that a measurement makes, besides the first, which pays for what is loaded once."""


@dataclass(frozen=True)
class Cost:
    """Seconds of one core and bytes that an episode takes, failed attempts included, and where the figures come from."""

    seconds: float
    size: float
    source: str

    def hours(self, episodes: int, workers: int) -> float:
        """How long so many workers take that each have a core."""
        return episodes * self.seconds / 3600 / workers

    def said(self, episodes: int, workers: int) -> str:
        """About how long and how much, in words."""
        minutes = 60 * self.hours(episodes, workers)
        time = f"{minutes / 60:.1f} h" if minutes >= 90 else f"{max(1, round(minutes))} min"
        size = episodes * self.size
        amount = f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{max(1, round(size / 1e6))} MB"
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
    sizes = [dataset.episode(slot).stat().st_size for slot, _ in pairs]
    return Cost(float(np.mean(seconds)), float(np.mean(sizes)), source)


def _seconds(record: SlotRecord) -> float:
    """What an episode took: all its attempts, or only the drawing where it shows the physics of another."""
    drawing = sum(seconds for name, seconds in record.phases.items() if not name.endswith(".cpu"))
    return sum(row["seconds"] for row in record.attempts) or drawing

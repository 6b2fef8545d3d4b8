"""`domino-data plan`: what exists, and what the rest costs."""

import os
from collections import Counter
from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pipeline.data.cameras import CAMERA_TYPES
from pipeline.data.clock import DEFAULT_FPS
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.meta import NamedCamera
from pipeline.data.errors import DominoError
from pipeline.data.recipe.growth import differences
from pipeline.data.recipe.model import Cell, Recipe, Slot
from pipeline.planning.warm import warm_up
from pipeline.tasks import TASKS
from pipeline.world.drawing.renderer import device_of

from .slot.fill import FillJob, fill_slot
from .state import PHYSICS, redone

# slots that a measurement makes, besides the first, which pays for what is loaded once
MEASURED = 3
UNSURE = 1.7  # factor within which the estimates of time lie


@dataclass(frozen=True)
class EpisodeCost:
    """What an episode takes (s, bytes), failed attempts included."""

    seconds: float
    size: float
    source: str
    core_seconds: float | None = None

    def core_hours(self, episodes: int) -> float:
        """Processor time of so many episodes."""
        return episodes * (self.seconds if self.core_seconds is None else self.core_seconds) / 3600

    def hours(self, episodes: int, workers: int) -> tuple[float, float]:
        """Hours: undisturbed, and at most."""
        hours, cores = episodes * self.seconds / workers / 3600, os.cpu_count() or 1
        shared = max(1.0, (os.getloadavg()[0] + workers) / cores) if workers <= cores else 1.0
        return hours, UNSURE * shared * hours

    def describe(self, episodes: int, workers: int) -> str:
        """About how long and how much, in words."""
        if not episodes:
            return "nothing is left to make"
        least, most = (
            f"{hours:.1f} h" if hours >= 1.5 else f"{max(1, round(60 * hours))} min"
            for hours in self.hours(episodes, workers)
        )
        size = episodes * self.size
        room = f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{max(1, round(size / 1e6))} MB"
        crew = f"{workers} worker{'' if workers == 1 else 's'}"
        spent = least if least == most else f"{least} to {most}"
        return f"{spent} on {crew} and {room} (estimated from {self.source})"


def typical(recipe: Recipe, source: str = "benchmarks") -> EpisodeCost:
    """What an episode takes by its recipe alone. Fitted: bytes within a factor of 1.6, processor
    time of 1.7.
    """
    kind, pixels = CAMERA_TYPES[recipe.camera], list[float]()
    for camera in recipe.cameras:
        own = camera if isinstance(camera, NamedCamera) else kind
        width, height = recipe.size or (own.width, own.height)
        pixels.append(width * height / (320 * 240))
    counts = recipe.counts()
    busy = {"clean": 0.0, "randomized": 1.0}.get(
        recipe.visuals,
        sum(n for cell, n in counts.items() if cell.domain == "randomized") / sum(counts.values()),
    )

    def coded(size: float, power: float) -> float:
        """Bytes of a frame of all cameras, by those of 320x240 pixels."""
        return size * sum(each**power for each in pixels)

    # a fifth of the step limit, and the lead
    seconds = [
        TASKS[cell.task].step_limit / 5 / DEFAULT_FPS
        + (recipe.lead if cell.level and cell.alpha else 0.0)
        for cell in counts
    ]
    frames = recipe.fps * float(np.average(seconds, weights=list(counts.values())))
    size = 95_000 + frames * (
        4300
        + coded(20_000, 0.74) * (1 + busy / 8)
        + recipe.depth * coded(7100, 0.77)
        + recipe.segmentation * coded(870, 0.77)
        + recipe.pointcloud * 10_800
    )
    slower = {"raster": 1.0, "raster-fast": 0.7, "rt": 100.0}[recipe.render]
    slower *= 1.5 if recipe.depth or recipe.segmentation or recipe.pointcloud else 1.0
    drawing = frames * slower * sum(0.0015 + 0.0032 * each for each in pixels)
    # physics is made once for all variants, failed attempts included; 15 MB a second are written
    return EpisodeCost(1.3 / recipe.variants + drawing + size / 15e6, size, source)


def cost_of(dataset: Dataset | None, recipe: Recipe) -> EpisodeCost:
    """Means of at most 2000 finished episodes, or `typical`."""
    if dataset is None or not dataset.manifest.exists():
        return typical(recipe)
    rows = dataset.present(recipe, "size", "seconds", "core_seconds")
    rows = rows.where(rows.accepted)
    if not len(rows):
        return typical(recipe)
    rows = rows.where(np.arange(len(rows)) % -(-len(rows) // 2000) == 0)
    of, tried = dataset.ask(lambda index: index.attempts(rows, "seconds"))
    spent = np.bincount(of, [seconds or 0.0 for (seconds,) in tried], len(rows))
    cores = rows.more["core_seconds"]
    return EpisodeCost(
        float(np.mean(np.where(spent, spent, rows.more["seconds"]))),
        float(np.mean(rows.more["size"])),
        "this dataset",
        float(np.mean(cores)) if np.all(cores) else None,
    )


def measure(recipe: Recipe) -> EpisodeCost:
    """Measure a few episodes in a temporary directory. Raises NoRenderer."""
    device_of(recipe.render)
    recipe = recipe.model_copy(update={"variants": 1})
    cells = [cell for cell, count in recipe.counts().items() if count]
    picked = [cells[int(i)] for i in np.linspace(0, len(cells) - 1, MEASURED).round()]
    slots = [Slot(picked[0], 0), *(Slot(cell, 1 + i) for i, cell in enumerate(picked))]
    warm_up(picked[0].embodiment)
    with TemporaryDirectory(prefix="domino-plan-") as folder:
        dataset = Dataset(Path(folder) / "dataset")
        dataset.create(recipe)
        jobs = [FillJob(str(dataset.root), recipe, slot) for slot in slots]
        records = [record for record in list(map(fill_slot, jobs))[1:] if record.accepted]
    if not records:
        return typical(recipe, "benchmarks: no measured attempt was accepted")
    seconds = [sum(row["seconds"] for row in record.attempts) for record in records]
    return EpisodeCost(
        float(np.mean(seconds)),
        float(np.mean([record.file.size for record in records])),
        f"{len(records)} episodes measured now",
        float(np.mean([record.core_seconds for record in records])),
    )


BOUNDS = ("tasks", "levels", "episodes", "total")
"""Keys of a recipe that bound a build's length."""


class Unbounded(DominoError):
    """A build without a bound; the message names the options."""


def check_bounded(given: Collection[str], recipe: Recipe, dataset: Dataset, workers: int) -> None:
    """Raise Unbounded for a new dataset with no BOUNDS `given`."""
    if any(key in given for key in BOUNDS) or dataset.manifest.exists():
        return
    values = plan(recipe, None, workers)
    raise Unbounded(
        f"this build would make {values['slots']:,} episodes, {values['estimate']}: choose with"
        f" {', '.join(f'--{key}' for key in BOUNDS)} or --manifest (for example --tasks click_bell"
        " --episodes 2), or add --yes"
    )


def plan(
    recipe: Recipe, dataset: Dataset | None, workers: int, cost: EpisodeCost | None = None
) -> dict[str, Any]:
    """The work that is left: cells, parts to make again (`redo`), estimated hours, core-hours
    and bytes. Raises DatasetError for a dataset of another recipe.
    """
    done, redo = Counter[Cell](), list[dict[str, Any]]()
    if dataset is not None and dataset.manifest.exists():
        if changed := differences(dataset.recipe(), recipe):
            raise DatasetError(
                f"{dataset.root} holds another recipe, which `build` refuses to change:"
                f" {'; '.join(changed)}"
            )
        rows = dataset.rows(recipe)
        there = dataset.there(recipe, rows)
        redo = redone(recipe, rows.where(there), there[there])
        done = Counter(slot.cell for slot in rows.where(there).slots)
    cost = cost or cost_of(dataset, recipe)
    cells = [
        asdict(cell) | {"episodes": count * recipe.variants, "finished": done[cell]}
        for cell, count in recipe.counts().items()
    ]
    slots = sum(cell["episodes"] for cell in cells)
    left = slots - done.total() + sum(row["slots"] for row in redo if row["what"] == PHYSICS)
    hours, most = cost.hours(left, workers)
    return {
        "cells": cells,
        "slots": slots,
        "finished": done.total(),
        "redo": redo,
        "workers": workers,
        "estimated_hours": hours,
        "estimated_hours_most": most,
        "estimated_core_hours": cost.core_hours(left),
        "estimated_bytes": int(left * cost.size),
        "estimate_from": cost.source,
        "estimate": cost.describe(left, workers),
    }

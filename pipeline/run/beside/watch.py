"""What stands beside the road of a build: progress, metrics, and early stop."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib.util import find_spec

from pipeline.crew.contract import Crew
from pipeline.crew.progress import SHOWN, Kind, Metrics, Progress
from pipeline.data.dataset import Dataset
from pipeline.data.process.machine import usable_cores
from pipeline.data.recipe.cells import Slot
from pipeline.data.recipe.model import Recipe
from pipeline.data.slots.records import SlotRecord
from pipeline.data.store.place import with_urls
from pipeline.planning.warm import warm_up
from pipeline.run.beside.early_stop import EarlyStop
from pipeline.run.compile_ahead import compiling_ahead, is_compiled
from pipeline.run.plan import cost_of
from pipeline.run.slot.fill import FillJob


class BuildWatch:
    """Sees every slot that ends: counts it, shows it, and returns the jobs that may start then."""

    def __init__(self, progress: Progress, metrics: Metrics, early_stop: EarlyStop) -> None:
        self.progress, self._metrics, self.early_stop = progress, metrics, early_stop
        self._reported = 0
        self._report_stopped()

    def finish(self, slot: Slot, record: SlotRecord) -> list[FillJob]:
        """Count a slot that ended, and return the jobs that may start now."""
        self.progress.add(record.attempts)
        self._metrics.add(record.attempts, record.phases)
        ready = self.early_stop.finish(slot, record.attempts)
        self._report_stopped()
        return ready

    def count_lost(self) -> None:
        """Count a lost worker."""
        self.progress.count_lost()
        self._metrics.count_lost()

    def _report_stopped(self) -> None:
        """Report the cells that were stopped since the last report."""
        for stop in self.early_stop.stops[self._reported :]:
            self.progress.count_stopped(stop.cell.path, stop.slots, stop.because)
            self.progress.write_line(stop.describe())
        self._reported = len(self.early_stop.stops)


@contextmanager
def watching(
    dataset: Dataset, recipe: Recipe, jobs: deque[FillJob], crew: Crew, shown: Kind
) -> Iterator[BuildWatch]:
    """The watch over a build; jobs that must wait for the judgement of their cells are taken
    away."""
    wanted = sum(recipe.counts().values())
    progress = SHOWN[shown](wanted, wanted - len(jobs))
    try:
        with compiling_ahead() if jobs else nullcontext():
            _announce(progress, dataset, recipe, jobs, crew)
            yield BuildWatch(progress, Metrics(crew), EarlyStop(dataset, recipe, jobs))
    finally:
        progress.close()


def _announce(
    progress: Progress, dataset: Dataset, recipe: Recipe, jobs: deque[FillJob], crew: Crew
) -> None:
    """Print what will be made, and compile once what each worker would compile."""
    if not jobs:
        return
    cost = cost_of(dataset, recipe)
    progress.write_line(
        f"episodes to make: {len(jobs):,}, in {with_urls(str(dataset.root))};"
        f" {cost.describe(len(jobs), crew.workers)}. Ctrl-C stops; rerun the same command to resume"
    )
    if crew.executor == "inline" and usable_cores() > 1 and find_spec("ray") is None:
        progress.write_line(
            f"one worker: uv pip install 'domino-data[ray]' lets all {usable_cores()} cores work"
        )
    if not is_compiled():
        progress.show_activity("compiling, once, about 15 s")
        if crew.executor != "inline":
            warm_up(jobs[0].slot.cell.embodiment)
    if crew.executor != "inline":
        progress.show_activity(f"starting {crew.workers} workers")

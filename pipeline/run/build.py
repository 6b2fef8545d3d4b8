"""`domino-data build`: fill every slot of a recipe that is not filled yet, then gather attempts, provenance and the report."""

import platform
from collections import Counter, deque
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.annotate.overlays import annotation_sheet
from pipeline.crew.contract import Crew, Died, Done
from pipeline.crew.loop import run
from pipeline.crew.progress import SHOWN, Kind, Metrics, Progress
from pipeline.crew.ray_session import session
from pipeline.data.atomic import sweep, write_atomic
from pipeline.data.brought import Brought
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.records import SlotRecord
from pipeline.data.reread import IndexWriter
from pipeline.data.sealed import seal
from pipeline.data.store.lock import exclusive
from pipeline.data.store.urls import with_urls
from pipeline.planning.warm import is_compiled, warm_up
from pipeline.report.page import refresh
from pipeline.run.doctor.packages import installed_version
from pipeline.run.drawing import draw_all, work_of
from pipeline.run.early_stop import EarlyStop, stopped_cells
from pipeline.run.identity.slot_keys import code_version
from pipeline.run.plan import cost_of
from pipeline.run.slot.fill import SlotJob, slot_worker
from pipeline.run.slot.node_check import NodeCheck
from pipeline.run.state import IMAGES, OPEN, SENTENCES, SlotState, missing
from pipeline.world.drawing.vulkan import ensure_renderer
from pipeline.world.objects.contract import FAMILIES
from pipeline.world.objects.from_files import directory_of
from pipeline.world.robots.pairs import MODELS

ATTEMPT_SECONDS = 600.0
"""What one attempt may take, rendering and writing included, before its worker counts as hung; the usual is one to three."""

_PACKAGES = ("domino-data", "sapien", "numpy", "numba", "h5py", "opencv-python-headless", "ray", "pyarrow")


@dataclass(frozen=True)
class BuildResult:
    """The result of a build.

    `slots` are wanted, variants included; of them the dataset has `accepted` and `given_up`. The rest counts this call: physical
    slots `made`; their `parts` made (a slot that was OPEN, or physics, images or sentences made again: run/state.py); `attempts`
    and `reasons` of failure; workers lost and replaced. `stopped` has a line for each cell that the recipe's floor stops.
    """

    slots: int
    accepted: int
    given_up: int
    made: int
    parts: dict[str, int]
    attempts: int
    reasons: dict[str, int]
    workers_lost: int
    stopped: list[str]


def build(root: Path, recipe: Recipe, crew: Crew, timeout: float = ATTEMPT_SECONDS, shown: Kind = "bar") -> BuildResult:
    """Build the dataset, or resume its build.

    Every file that was written since it was last read is read: an episode whose bytes differ from the index's is made again;
    of one whose assets are missing, the images are.

    A worker that spends more than `timeout` seconds on one attempt counts as hung. An attempt that kills two workers is recorded as
    failed, and the slot's next seed is tried. Other variants are drawn from the state logs of the first.

    Raises DatasetError for a directory of another recipe and for variants that cannot be drawn, PolicyError if the policy to
    correct cannot be made or was made for another setup, Busy if another command writes the dataset, NoRenderer without Vulkan,
    CrewError if workers cannot be started or keep dying.
    """
    device = ensure_renderer()
    dataset = Dataset(root)
    if recipe.corrections and not dataset.manifest.exists():
        from pipeline.evaluate.correct import check_policy  # policies take a second to import

        check_policy(recipe)
    # a cluster that cannot be joined leaves no dataset, which would hold the place for this recipe
    with session(crew) if crew.address and not dataset.manifest.exists() else nullcontext():
        dataset.create(recipe)
        with exclusive(root):
            return _build(dataset, recipe, crew, timeout, shown, device)


def _build(dataset: Dataset, recipe: Recipe, crew: Crew, timeout: float, shown: Kind, device: str) -> BuildResult:
    """As `build`, in a directory that is the recipe's and has what it needs."""
    slots = list(recipe.physical_slots())
    sweep(dataset.root)
    with IndexWriter(dataset, recipe) as writer:
        known = missing(dataset, recipe, writer)
        jobs, todo = _jobs(dataset, recipe, known), list(known)
        parts = Counter(known[slot].todo for slot in todo)
        progress = SHOWN[shown](len(slots), len(slots) - len(todo))
        try:
            _announce(progress, dataset, recipe, todo, crew)
            early_stop = EarlyStop(dataset, recipe, jobs)
            lost = _fill(dataset, jobs, crew, timeout, SlotListeners(progress, Metrics(crew), early_stop, writer))
            if recipe.variants > 1:
                progress.close()
                others = (slot for slot in recipe.slots() if slot.variant)
                work = work_of(dataset, dataset, recipe, others, writer.catch_up())
                problems = draw_all(work, writer, crew, timeout, shown != "bar")
                if problems:
                    raise DatasetError(f"{len(problems)} variants cannot be drawn: {problems[0]}")
        finally:
            progress.close()
            # a worker that was killed may have been writing an asset
            sweep(dataset.assets)
            attempts = dataset.write_attempts(recipe)
            write_atomic(dataset.provenance, seal(provenance(device, recipe)))
    parts[OPEN] -= sum(known[slot].todo == OPEN for slot in early_stop.untried)
    accepted = dataset.present(recipe).accepted
    refresh(dataset, annotation_sheet)
    reasons = attempts["reason"].value_counts().to_pylist()
    return BuildResult(
        slots=len(slots) * recipe.variants,
        accepted=int(accepted.sum()),
        given_up=int((~accepted).sum()),
        made=len(todo) - len(early_stop.untried),
        parts=dict(+parts),
        attempts=len(attempts),
        reasons={each["values"]: each["counts"] for each in reasons if each["values"]},
        workers_lost=lost,
        stopped=[stop.describe() for stop in stopped_cells(dataset, recipe)],
    )


def _jobs(dataset: Dataset, recipe: Recipe, known: dict[Slot, SlotState]) -> deque[SlotJob]:
    """What the workers are sent, in order."""
    # a failed attempt that is kept is only made with its slot
    renewed = {slot for slot, state in known.items() if state.todo in (IMAGES, SENTENCES) and recipe.keep_failures == "none"}
    records = {slot: record for slot, record in dataset.records(recipe) if slot in renewed} if renewed else {}
    root, code = str(dataset.root.resolve()), code_version()
    return deque(SlotJob(root, recipe, slot, code, records.get(slot)) for slot in known)


def _announce(progress: Progress, dataset: Dataset, recipe: Recipe, todo: list[Slot], crew: Crew) -> None:
    """Print what will be made, and compile once what each worker would compile."""
    if not todo:
        return
    cost = cost_of(dataset, recipe)
    progress.write_line(
        f"episodes to make: {len(todo):,}, in {with_urls(str(dataset.root))}; {cost.describe(len(todo), crew.workers)}. "
        "Ctrl-C stops; rerun the same command to resume"
    )
    if not is_compiled():
        progress.show_activity("compiling, once, about 20 s")
        if crew.executor != "inline":
            warm_up(todo[0].cell.embodiment)
    if crew.executor != "inline":
        progress.show_activity(f"starting {crew.workers} workers")


@dataclass(frozen=True)
class SlotListeners:
    """Receives finished slots: progress display, metrics, early stop of cells, index."""

    progress: Progress
    metrics: Metrics
    early_stop: EarlyStop
    writer: IndexWriter

    def finish(self, slot: Slot, record: SlotRecord) -> list[SlotJob]:
        """Write down a slot that ended, and return the jobs that may start now."""
        self.writer.add(slot, record)
        self.progress.add(record.attempts)
        self.metrics.add(record.attempts, record.phases)
        before = len(self.early_stop.stops)
        ready = self.early_stop.finish(slot, record.attempts)
        self.report_stopped(before)
        return ready

    def count_lost(self) -> None:
        """Count a lost worker."""
        self.progress.count_lost()
        self.metrics.count_lost()

    def report_stopped(self, before: int = 0) -> None:
        """Report the stopped cells after the first `before` ones."""
        for stop in self.early_stop.stops[before:]:
            self.progress.count_stopped(stop.cell.path, stop.slots, stop.because)
            self.progress.write_line(stop.describe())


def _fill(dataset: Dataset, jobs: deque[SlotJob], crew: Crew, timeout: float, listeners: SlotListeners) -> int:
    """Have all jobs done and their records written; the number of workers lost on the way."""
    listeners.report_stopped()
    check = NodeCheck(str(dataset.root.resolve()), code_version())
    with closing(run(slot_worker, jobs, crew, timeout, check, listeners.count_lost)) as ends:
        for end in ends:
            match end:
                case Done(job, record):
                    jobs.extend(listeners.finish(job.slot, record))
                case Died(job):
                    jobs.append(job.without(end))
    return listeners.progress.lost


def provenance(renderer: str, recipe: Recipe) -> dict[str, Any]:
    """What made the dataset: hash of the code, package versions, Python, renderer, processor. No clock."""
    return {
        "code_version": code_version(),
        "licences": _licences(recipe),
        "packages": {name: installed_version(name) or "missing" for name in _PACKAGES},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": processor(),
        "renderer": renderer,
    }


def _licences(recipe: Recipe) -> dict[str, str]:
    """Licences of the robots, of the objects from files, and of what the recipe brings for the room."""
    robots = {name: MODELS[name].settings.licence for name in recipe.robots() if name in MODELS}
    families = [(name, FAMILIES[name]) for names in recipe.objects.values() for name in names]
    brought = {"textures": recipe.textures, "environment": recipe.environment}
    own = {name: found.licence for name, found in brought.items() if isinstance(found, Brought)}
    return robots | own | {name: files.settings.licence for name, family in families if (files := directory_of(family))}


def processor() -> str:
    """Model name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.processor())

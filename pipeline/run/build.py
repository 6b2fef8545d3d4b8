"""`domino-data build`: index, missing, work, record."""

from collections import Counter, deque
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from pipeline.annotate.overlays import annotation_sheet
from pipeline.crew.contract import Crew, Died, Done
from pipeline.crew.loop import run
from pipeline.crew.progress import Kind
from pipeline.crew.ray_session import session
from pipeline.data.atomic import exclusive, sweep, write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.keys import seal
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.records import SlotRecord
from pipeline.data.slots.reread import IndexWriter
from pipeline.report.page import refresh
from pipeline.run.beside.early_stop import stopped_cells
from pipeline.run.beside.watch import BuildWatch, watching
from pipeline.run.drawing import draw_variants
from pipeline.run.identity.slot_keys import code_version
from pipeline.run.provenance import provenance
from pipeline.run.slot.fill import FillJob, NodeCheck, demonstrator_of, slot_jobs, slot_worker
from pipeline.run.state import SlotState, missing
from pipeline.world.drawing.vulkan import ensure_renderer

ATTEMPT_SECONDS = 600.0
"""What one attempt may take, until its worker counts as hung; the usual is one to three."""


@dataclass(frozen=True)
class BuildResult:
    """The result of a build.

    `slots` are wanted, variants included, of which the dataset has `accepted` and `given_up`. The
    rest counts this call: physical slots `made`, their `parts` (OPEN, or what was made again:
    run/state.py), `attempts`, `reasons` of failure, workers lost. `stopped` has a line for each
    stopped cell."""

    slots: int
    accepted: int
    given_up: int
    made: int
    parts: dict[str, int]
    attempts: int
    reasons: dict[str, int]
    workers_lost: int
    stopped: list[str]


def build(
    root: Path, recipe: Recipe, crew: Crew, timeout: float = ATTEMPT_SECONDS, shown: Kind = "bar"
) -> BuildResult:
    """Build the dataset, or resume its build: an episode with other bytes than its record's is made
    again, and images of which an asset is missing.

    A worker that spends more than `timeout` seconds on one attempt counts as hung. An attempt that
    kills two workers is recorded as failed. Other variants are drawn from the state logs of the
    first.

    Raises DatasetError, PolicyError, Busy, NoRenderer, CrewError."""
    device, dataset = ensure_renderer(), Dataset(root)
    with _alone(dataset, recipe, crew):
        try:
            todo, watch = _fill(dataset, recipe, crew, timeout, shown)
        finally:
            # a worker that was killed may have been writing an asset
            sweep(dataset.assets)
            dataset.write_attempts(recipe)
            write_atomic(dataset.provenance, seal(provenance(device, recipe)))
        refresh(dataset, annotation_sheet)
        return _result(dataset, recipe, todo, watch)


@contextmanager
def _alone(dataset: Dataset, recipe: Recipe, crew: Crew) -> Iterator[None]:
    """The dataset's directory exists, is the recipe's, and no other command writes it."""
    new = not dataset.manifest.exists()
    if new:
        demonstrator_of(recipe).check()
    # a cluster that cannot be joined leaves no dataset, which would hold the place for this recipe
    with session(crew) if crew.address and new else nullcontext():
        dataset.create(recipe)
        with exclusive(dataset.root):
            sweep(dataset.root)
            yield


def _fill(
    dataset: Dataset, recipe: Recipe, crew: Crew, timeout: float, shown: Kind
) -> tuple[dict[Slot, SlotState], BuildWatch]:
    """Index, missing, work, record. Returns the slots that were missing, and who saw them made."""
    with IndexWriter(dataset, recipe) as index:
        todo = missing(dataset, recipe, index)
        jobs = slot_jobs(dataset, recipe, todo)
        with (
            watching(dataset, recipe, jobs, crew, shown) as watch,
            closing(_work(dataset, jobs, crew, timeout, watch)) as done,
        ):
            for slot, record in done:
                index.add(slot, record)
                jobs.extend(watch.finish(slot, record))
        draw_variants(dataset, recipe, index, crew, timeout, shown != "bar")
    return todo, watch


def _work(
    dataset: Dataset, jobs: deque[FillJob], crew: Crew, timeout: float, watch: BuildWatch
) -> Generator[tuple[Slot, SlotRecord]]:
    """Have all jobs done; every slot as it ends."""
    check = NodeCheck(str(dataset.root.resolve()), code_version())
    with closing(run(slot_worker, jobs, crew, timeout, check, watch.count_lost)) as ends:
        for end in ends:
            match end:
                case Done(job, record):
                    yield job.slot, record
                case Died(job):
                    jobs.append(job.without(end))


def _result(
    dataset: Dataset, recipe: Recipe, todo: dict[Slot, SlotState], watch: BuildWatch
) -> BuildResult:
    rows, untried = dataset.present(recipe), watch.early_stop.untried
    _, tried = dataset.ask(lambda index: index.attempts(rows, "reason"))
    accepted = int(rows.accepted.sum())
    return BuildResult(
        slots=sum(recipe.counts().values()) * recipe.variants,
        accepted=accepted,
        given_up=len(rows) - accepted,
        made=len(todo) - len(untried),
        parts=dict(Counter(state.todo for slot, state in todo.items() if slot not in untried)),
        attempts=len(tried),
        reasons=dict(Counter(reason for (reason,) in tried if reason).most_common()),
        workers_lost=watch.progress.lost,
        stopped=[stop.describe() for stop in stopped_cells(dataset, recipe)],
    )

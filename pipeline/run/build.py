"""`domino-data build`: index, missing, work, record."""

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from pipeline.crew.contract import Crew, Died, Done
from pipeline.crew.loop import run
from pipeline.crew.progress import SHOWN, Kind, Progress
from pipeline.crew.ray_session import session
from pipeline.data.atomic import exclusive, sweep
from pipeline.data.dataset import Dataset
from pipeline.data.process.machine import usable_cores
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.reread import IndexWriter
from pipeline.data.store.place import with_urls
from pipeline.planning.warm import warm_up
from pipeline.world.drawing.renderer import device_of

from .compile_ahead import compiling_ahead, is_compiled
from .identity.core import code_version
from .plan import cost_of
from .provenance import write_provenance
from .render import draw_variants
from .slot.fill import FillJob, check_node, demonstrator_of, fill_in_steps, slot_jobs
from .state import SlotState, missing

ATTEMPT_SECONDS = 600.0
"""What one attempt may take, until its worker counts as hung; the usual is one to three."""


@dataclass(frozen=True)
class BuildResult:
    """The result of a build: `slots` wanted, variants included, of which the dataset has `accepted`
    and `given_up`. The rest counts this call: physical slots `made`, their `parts` (OPEN, or what
    was made again: run/state.py), `attempts`, `reasons` of failure, workers lost."""

    slots: int
    accepted: int
    given_up: int
    made: int
    parts: dict[str, int]
    attempts: int
    reasons: dict[str, int]
    workers_lost: int


def build(
    root: Path, recipe: Recipe, crew: Crew, timeout: float = ATTEMPT_SECONDS, shown: Kind = "bar"
) -> BuildResult:
    """Build the dataset, or resume its build. An attempt longer than `timeout` s counts as hung.
    Raises DatasetError, PolicyError, Busy, NoRenderer, CrewError.
    """
    device, dataset = device_of(recipe.render), Dataset(root)
    with _alone(dataset, recipe, crew):
        try:
            todo, lost = _build(dataset, recipe, crew, timeout, shown)
        finally:
            # a worker that was killed may have been writing an asset
            sweep(dataset.assets)
            dataset.write_attempts(recipe)
            write_provenance(dataset, device, recipe)
        return _result(dataset, recipe, todo, lost)


@contextmanager
def _alone(dataset: Dataset, recipe: Recipe, crew: Crew) -> Iterator[None]:
    new = not dataset.manifest.exists()
    if new:
        demonstrator_of(recipe).check()
    # a cluster that cannot be joined leaves no dataset, which would hold the place for this recipe
    with session(crew) if crew.address and new else nullcontext():
        dataset.create(recipe)
        with exclusive(dataset.root):
            sweep(dataset.root)
            yield


def _build(
    dataset: Dataset, recipe: Recipe, crew: Crew, timeout: float, shown: Kind
) -> tuple[dict[Slot, SlotState], int]:
    """Returns the slots that were missing, and the workers lost."""
    with IndexWriter(dataset, recipe) as index:
        todo = missing(dataset, recipe, index)
        jobs = slot_jobs(dataset, recipe, todo)
        check = partial(check_node, str(dataset.root.resolve()), code_version(), recipe.render)
        with (
            _progress(dataset, recipe, jobs, crew, shown) as progress,
            closing(
                run(lambda: fill_in_steps, jobs, crew, timeout, check, progress.count_lost)
            ) as ends,
        ):
            for end in ends:
                match end:
                    case Done(job, record):
                        index.add(job.slot, record)
                        progress.add(record.attempts)
                    case Died(job):
                        jobs.append(job.without(end))
        if recipe.variants > 1:
            draw_variants(dataset, recipe, index, crew, timeout, shown != "bar")
    return todo, progress.lost


@contextmanager
def _progress(
    dataset: Dataset, recipe: Recipe, jobs: deque[FillJob], crew: Crew, shown: Kind
) -> Iterator[Progress]:
    wanted = sum(recipe.counts().values())
    with (
        closing(SHOWN[shown](wanted, wanted - len(jobs))) as progress,
        compiling_ahead() if jobs else nullcontext(),
    ):
        if jobs:
            progress.write_line(
                f"episodes to make: {len(jobs):,}, in {with_urls(str(dataset.root))};"
                f" {cost_of(dataset, recipe).describe(len(jobs), crew.workers)}."
                " Ctrl-C stops; rerun the same command to resume"
            )
            if not is_compiled():
                progress.show_activity("compiling, once, about 30 s")
                if crew.executor != "inline":
                    warm_up(jobs[0].slot.cell.embodiment)
            if crew.executor != "inline":
                progress.show_activity(f"starting {crew.workers} workers")
            elif usable_cores() > 1 and find_spec("ray") is None:
                progress.write_line("uv pip install 'domino-data[ray]' lets all cores work")
        yield progress


def _result(
    dataset: Dataset, recipe: Recipe, todo: Mapping[Slot, SlotState], lost: int
) -> BuildResult:
    rows = dataset.present(recipe)
    _, tried = dataset.ask(lambda index: index.attempts(rows, "reason"))
    accepted = int(rows.accepted.sum())
    return BuildResult(
        slots=sum(recipe.counts().values()) * recipe.variants,
        accepted=accepted,
        given_up=len(rows) - accepted,
        made=len(todo),
        parts=dict(Counter(state.todo for state in todo.values())),
        attempts=len(tried),
        reasons=dict(Counter(reason for (reason,) in tried if reason).most_common()),
        workers_lost=lost,
    )

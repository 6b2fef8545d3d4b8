"""Which slots are to be drawn again from stored episodes, and the drawing of them all."""

from collections import deque
from collections.abc import Callable, Iterable
from contextlib import ExitStack, closing
from dataclasses import dataclass

from tqdm import tqdm

from pipeline.crew.contract import Crew, Died, Done
from pipeline.crew.loop import run
from pipeline.data.dataset import Dataset
from pipeline.data.ledger.files import LedgerWriter
from pipeline.data.ledger.records import SlotRecord
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.run.identity.slot_keys import code_version, redrawn_keys
from pipeline.run.slot.redraw import DrawJob, draw_slot, is_drawn, origin_of
from pipeline.run.slot.running import NodeCheck


@dataclass(frozen=True)
class DrawWork:
    """What is to be drawn into the dataset `out`: a job a slot.

    `new` are the slots without an entry there. `done` counts slots that are drawn already, `open` those without a source episode.
    """

    out: Dataset
    jobs: list[DrawJob]
    new: frozenset[Slot]
    done: int
    open: int


def work_of(source: Dataset, out: Dataset, recipe: Recipe, slots: Iterable[Slot]) -> DrawWork:
    """What is to be drawn of `slots` of the recipe of `out` from the episodes of `source`.

    Where both are the same dataset, its other variants are drawn from the first ones.
    """
    held, jobs, done, missing = source.recipe(), [], 0, 0
    if source.root == out.root:
        held = held.model_copy(update={"variants": 1})
    records, drawn = dict(source.records(held)), dict(out.records(recipe))
    here, there, code = str(source.root.resolve()), str(out.root.resolve()), code_version()
    for slot in slots:
        origin, same_look = origin_of(held, recipe, slot)
        record = records.get(origin)
        if record is None or (record.accepted and not source.episode(origin).exists()):
            missing += 1
        elif is_drawn(out, slot, drawn.get(slot), record, redrawn_keys(recipe, slot, record.keys)):
            done += 1
        else:
            jobs.append(DrawJob(here, there, recipe, slot, origin, record, same_look, code))
    return DrawWork(out, jobs, frozenset(job.slot for job in jobs if job.slot not in drawn), done, missing)


def draw_all(work: DrawWork, ledger: LedgerWriter, crew: Crew, timeout: float, quiet: bool = False) -> list[str]:
    """Do all of it under one progress bar and write the entries; what could not be drawn, one line each, sorted.

    A worker that spends more than `timeout` seconds on one episode counts as hung; an episode that takes two workers with it is a
    problem of its own. However it ends, no new episode stays that has no entry. Raises CrewError if workers do not start or last.
    """
    problems, unfinished = list[str](), set(work.new)
    bar = tqdm(total=work.done + len(work.jobs), initial=work.done, unit="ep", disable=quiet, dynamic_ncols=True)
    check = NodeCheck(work.jobs[0].out, work.jobs[0].code) if work.jobs else None
    with ExitStack() as ended, bar, closing(run(drawer, deque(work.jobs), crew, timeout, check)) as ends:
        ended.callback(work.out.withdraw, unfinished)
        for end in ends:
            match end:
                case Done(_, str() as problem):
                    problems.append(problem)
                case Done(job, SlotRecord() as record):
                    unfinished.discard(job.slot)
                    ledger.add(job.slot, record)
                case Died(job, reason):
                    problems.append(f"{job.slot.path}: {reason.replace('_', ' ')} twice while drawing it")
            if problems:
                bar.set_postfix_str(f"{len(problems)} cannot be drawn")
            bar.update(1)
    return sorted(problems)


def drawer() -> Callable[[DrawJob], SlotRecord | str]:
    """`draw_slot`, in a process that has hashed its code already."""
    code_version()
    return draw_slot

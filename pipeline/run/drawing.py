"""Which slots are to be drawn again from stored episodes, and the drawing of them all."""

from collections import deque
from collections.abc import Callable, Collection, Iterable
from contextlib import closing
from dataclasses import dataclass

from tqdm import tqdm

from pipeline.crew.contract import Crew, Died, Done
from pipeline.crew.loop import run
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.recipe.model import Recipe, Slot
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.records import SlotRecord
from pipeline.data.slots.reread import IndexWriter
from pipeline.run.identity.slot_keys import code_version, redrawn_keys
from pipeline.run.slot.fill import NodeCheck
from pipeline.run.slot.redraw import DrawJob, draw_slot, is_drawn, origin_of


@dataclass(frozen=True)
class DrawWork:
    """What is to be drawn into the dataset `out`: a job a slot; slots that are `done`, and `open`
    ones without a source episode."""

    out: Dataset
    jobs: list[DrawJob]
    done: int
    open: int


def work_of(
    source: Dataset,
    out: Dataset,
    recipe: Recipe,
    slots: Iterable[Slot],
    damaged: Collection[Slot] = (),
) -> DrawWork:
    """What is to be drawn of `slots` of the recipe of `out` from the episodes of `source`. Of the
    same dataset, variants are drawn from the first ones. Those that are `damaged` are drawn
    again."""
    held, jobs, done, missing = source.recipe(), [], 0, 0
    if source.root == out.root:
        held = held.model_copy(update={"variants": 1})
    records, drawn, assets = (
        dict(source.records(held)),
        dict(out.records(recipe)),
        AssetStore(out.bodies).keys(),
    )
    here, there, code = str(source.root.resolve()), str(out.root.resolve()), code_version()
    for slot in slots:
        origin, same_look = origin_of(held, recipe, slot)
        record = records.get(origin)
        if record is None:
            missing += 1
        elif slot not in damaged and is_drawn(
            drawn.get(slot), record, redrawn_keys(recipe, slot, record.keys), assets
        ):
            done += 1
        else:
            jobs.append(DrawJob(here, there, recipe, slot, origin, record, same_look, code))
    return DrawWork(out, jobs, done, missing)


def draw_all(
    work: DrawWork, writer: IndexWriter, crew: Crew, timeout: float, quiet: bool = False
) -> list[str]:
    """Do all of it under one progress bar and write it down; what could not be drawn, one line
    each, sorted. An episode that takes two workers with it is a problem of its own. Raises
    CrewError."""
    problems = list[str]()
    bar = tqdm(
        total=work.done + len(work.jobs),
        initial=work.done,
        unit="ep",
        disable=quiet,
        dynamic_ncols=True,
    )
    check = NodeCheck(work.jobs[0].out, work.jobs[0].code) if work.jobs else None
    with bar, closing(run(drawer, deque(work.jobs), crew, timeout, check)) as ends:
        for end in ends:
            match end:
                case Done(_, str() as problem):
                    problems.append(problem)
                case Done(job, SlotRecord() as record):
                    writer.add(job.slot, record)
                case Died(job, reason):
                    problems.append(
                        f"{job.slot.path}: {reason.replace('_', ' ')} twice while drawing it"
                    )
            if problems:
                bar.set_postfix_str(f"{len(problems)} cannot be drawn")
            bar.update(1)
    return sorted(problems)


def draw_variants(
    dataset: Dataset, recipe: Recipe, writer: IndexWriter, crew: Crew, timeout: float, quiet: bool
) -> None:
    """Draw the other looks of a recipe's episodes from the first ones. Raises DatasetError."""
    if recipe.variants == 1:
        return
    others = (slot for slot in recipe.slots() if slot.variant)
    problems = draw_all(
        work_of(dataset, dataset, recipe, others, writer.catch_up()), writer, crew, timeout, quiet
    )
    if problems:
        raise DatasetError(f"{len(problems)} variants cannot be drawn: {problems[0]}")


def drawer() -> Callable[[DrawJob], SlotRecord | str]:
    """`draw_slot`, in a process that has hashed its code already."""
    code_version()
    return draw_slot

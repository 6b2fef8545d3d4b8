"""`domino-data render`: new images of stored episodes, and further variants."""

from collections import deque
from collections.abc import Collection, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any

from tqdm import tqdm

from pipeline.annotate.overlays import annotation_sheet
from pipeline.crew.contract import Crew, Died, Done
from pipeline.crew.loop import run
from pipeline.data.atomic import exclusive, sweep
from pipeline.data.dataset import Dataset, DatasetError, check_apart
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.visuals import LOOK
from pipeline.data.recipe.model import Recipe, Slot, parse_recipe
from pipeline.data.slots.assets import AssetStore
from pipeline.data.slots.records import SlotRecord
from pipeline.data.slots.reread import IndexWriter
from pipeline.report.page import refresh
from pipeline.world.cameras import CameraError, check_links, wanted_cameras
from pipeline.world.drawing.renderer import device_of

from .identity.core import code_version
from .identity.slot_keys import RecipeKeys
from .provenance import write_provenance
from .slot.fill import check_node
from .slot.redraw import DrawJob, draw_slot, is_drawn, origin_of

IMAGE_SECONDS = 600.0
"""What drawing one episode may take, until its worker counts as hung."""


@dataclass(frozen=True)
class RenderResult:
    """The result of a rendering.

    `slots` are wanted; of them `accepted` have an episode now, `given_up` failed, `open` are not
    built yet in the source. `drawn` counts this call; `problems` has a line for each episode that
    could not be drawn.
    """

    slots: int
    accepted: int
    given_up: int
    open: int
    drawn: int
    problems: tuple[str, ...]


def render(
    source: Dataset,
    out: Dataset,
    changes: dict[str, Any],
    crew: Crew,
    *,
    quiet: bool = False,
    flags: Mapping[str, str] | None = None,
) -> RenderResult:
    """Draw every finished episode of `source` into `out`, unless it is up to date.

    `changes` are recipe keys that differ. Raises DatasetError, Busy, RecipeError, CameraError,
    NoRenderer, CrewError.
    """
    check_apart(out.root, source.root)
    source.check_seal()
    held = source.recipe()
    recipe = parse_recipe(held.model_dump() | changes, "options", flags)
    oldest = _check_cameras(source, held, recipe)
    look = oldest if origin_of(held, recipe, next(iter(held.slots())))[1] else LOOK
    device = device_of(recipe.render, look)
    out.create(recipe)
    with exclusive(out.root):
        sweep(out.root)
        try:
            with IndexWriter(out, recipe) as writer:
                work = work_of(source, out, recipe, recipe.slots(), writer.catch_up())
                problems = draw_all(work, writer, crew, IMAGE_SECONDS, quiet, look)
        finally:
            out.write_attempts(recipe)
            write_provenance(out, device, recipe, drawn_from=_provenance(source))
        refresh(out, annotation_sheet)
        accepted = out.present(recipe).accepted
        return RenderResult(
            slots=work.done + work.open + len(work.jobs),
            accepted=int(accepted.sum()),
            given_up=int((~accepted).sum()),
            open=work.open,
            drawn=len(work.jobs) - len(problems),
            problems=tuple(problems),
        )


def _provenance(source: Dataset) -> dict[str, Any]:
    try:
        return source.made_by()
    except DatasetError:
        return {}


def _check_cameras(source: Dataset, held: Recipe, recipe: Recipe) -> int:
    """Try the cameras on each task's and robot's first episode; returns their oldest look."""
    seen, looks = set(), [LOOK]
    for slot, record in source.records(held):
        kind = slot.cell.task, slot.cell.embodiment
        if not record.accepted or kind in seen:
            continue
        path = source.episode(slot)
        try:
            with EpisodeFile(path) as file:
                stored = [info.camera(name) for name, info in file.meta.drawing.cameras.items()]
                looks.append(file.meta.drawing.visuals.look)
                log = file.read().log
                check_links(wanted_cameras(stored, recipe, log.sides), log.bodies)
        except CameraError as error:
            raise CameraError(f"--cameras: {error} (in {path.relative_to(source.root)})") from error
        except EpisodeError:
            continue  # reported when it is to be drawn
        seen.add(kind)
    if not seen:
        raise DatasetError(f"{source.root} has no finished episodes to draw: build it first")
    return min(looks)


@dataclass(frozen=True)
class DrawWork:
    """A job a slot; slots that are `done`, and `open` ones without a source episode."""

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
    """What to draw of `slots` of `recipe` from `source`; `damaged` episodes are drawn again."""
    held, jobs, done, missing = source.recipe(), list[DrawJob](), 0, 0
    if source.root == out.root:
        held = held.model_copy(update={"variants": 1})
    records, drawn = dict(source.records(held)), dict(out.records(recipe))
    keys, assets = RecipeKeys(recipe), AssetStore(out.bodies).keys()
    here, there = str(source.root.resolve()), str(out.root.resolve())
    for slot in slots:
        origin, same_look = origin_of(held, recipe, slot)
        record = records.get(origin)
        if record is None:
            missing += 1
        elif slot not in damaged and is_drawn(
            drawn.get(slot), record, keys.redrawn(slot, record.keys), assets
        ):
            done += 1
        else:
            jobs.append(DrawJob(here, there, recipe, slot, origin, record, same_look))
    return DrawWork(jobs, done, missing)


def draw_all(
    work: DrawWork,
    writer: IndexWriter,
    crew: Crew,
    timeout: float,
    quiet: bool = False,
    look: int = LOOK,
) -> list[str]:
    """Draw and record all; returns a line for each failure. Raises CrewError."""
    problems = list[str]()
    bar = tqdm(
        total=work.done + len(work.jobs),
        initial=work.done,
        unit="ep",
        disable=quiet,
        dynamic_ncols=True,
    )
    check = None
    if work.jobs:
        first = work.jobs[0]
        check = partial(check_node, first.out, code_version(), first.recipe.render, look)
    with bar, closing(run(lambda: draw_slot, deque(work.jobs), crew, timeout, check)) as ends:
        for end in ends:
            match end:
                case Done(_, str() as problem):
                    problems.append(problem)
                case Done(job, SlotRecord() as record):
                    writer.add(job.slot, record)
                case Died(job, reason):
                    why = reason.replace("_", " ")
                    problems.append(f"{job.slot.path}: {why} twice while drawing it")
            if problems:
                bar.set_postfix_str(f"{len(problems)} cannot be drawn")
            bar.update(1)
    return sorted(problems)


def draw_variants(
    dataset: Dataset, recipe: Recipe, writer: IndexWriter, crew: Crew, timeout: float, quiet: bool
) -> None:
    """Draw other looks from the first ones. Raises DatasetError."""
    others = (slot for slot in recipe.slots() if slot.variant)
    work = work_of(dataset, dataset, recipe, others, writer.catch_up())
    if problems := draw_all(work, writer, crew, timeout, quiet):
        raise DatasetError(f"{len(problems)} variants cannot be drawn: {problems[0]}")

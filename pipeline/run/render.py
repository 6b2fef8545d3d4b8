"""`domino-data render`: new images of a dataset's episodes, in a dataset of their own."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.annotate.overlays import annotation_sheet
from pipeline.crew.contract import Crew
from pipeline.data.atomic import exclusive, sweep, write_atomic
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.keys import seal
from pipeline.data.recipe.model import Recipe, parse_recipe
from pipeline.data.slots.reread import IndexWriter
from pipeline.report.page import refresh
from pipeline.run.build import ATTEMPT_SECONDS
from pipeline.run.drawing import draw_all, work_of
from pipeline.run.provenance import provenance
from pipeline.world.cameras import CameraError, check_links, wanted_cameras
from pipeline.world.drawing.vulkan import ensure_renderer


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
    """Draw every finished episode of `source` into the dataset `out`; episodes that are up to date
    there are skipped.

    `changes` are keys of the recipe (preset, cameras, size, sensors, visuals, variants) that differ
    from the source's, `flags` the options that gave them, for messages. Raises DatasetError for a
    source that is no dataset or has no episodes, or if `out` holds another recipe; Busy if another
    command writes `out`; RecipeError and CameraError for changes that cannot be drawn; NoRenderer
    without Vulkan; CrewError if workers cannot be started or keep dying.
    """
    here, there = source.root.resolve(), out.root.resolve()
    if here.is_relative_to(there) or there.is_relative_to(here):
        raise DatasetError(
            f"--out {out.root} is the dataset itself, within it or around it: name another"
            " directory"
        )
    source.check_seal()
    held = source.recipe()
    recipe = parse_recipe(held.model_dump() | changes, "options", flags)
    _check_cameras(source, held, recipe)
    device = ensure_renderer()
    out.create(recipe)
    with exclusive(out.root):
        return _draw(source, out, recipe, crew, quiet, device)


def _draw(
    source: Dataset, out: Dataset, recipe: Recipe, crew: Crew, quiet: bool, device: str
) -> RenderResult:
    """As `render`, into a directory that is the recipe's and has what it needs."""
    sweep(out.root)
    try:
        with IndexWriter(out, recipe) as writer:
            work = work_of(source, out, recipe, recipe.slots(), writer.catch_up())
            problems = draw_all(work, writer, crew, ATTEMPT_SECONDS, quiet)
    finally:
        out.write_attempts(recipe)
        write_atomic(
            out.provenance, seal(provenance(device, recipe) | {"drawn_from": _provenance(source)})
        )
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
    """The provenance of the source; empty if its file is missing or damaged, which `verify`
    reports."""
    try:
        return source.made_by()
    except DatasetError:
        return {}


def _check_cameras(source: Dataset, held: Recipe, recipe: Recipe) -> None:
    """Try the wanted cameras on the first episode of every task and robot, before anything is
    written."""
    seen = set()
    for slot, record in source.records(held):
        kind = slot.cell.task, slot.cell.embodiment
        if not record.accepted or kind in seen:
            continue
        path = source.episode(slot)
        try:
            with EpisodeFile(path) as file:
                stored = [info.camera(name) for name, info in file.meta.drawing.cameras.items()]
                log = file.read().log
                check_links(wanted_cameras(stored, recipe, log.sides), log.bodies)
        except CameraError as error:
            raise CameraError(f"--cameras: {error} (in {path.relative_to(source.root)})") from error
        except EpisodeError:
            continue  # reported when it is to be drawn
        seen.add(kind)
    if not seen:
        raise DatasetError(f"{source.root} has no finished episodes to draw: build it first")

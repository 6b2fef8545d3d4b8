"""build, plan, render and demo."""

import json
import sys
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from pipeline.crew.progress import SHOWN, Kind
from pipeline.data.dataset import Dataset
from pipeline.data.process.machine import usable_cores
from pipeline.data.store.place import with_urls

from . import common
from .common import number, option
from .options import EVERY, FLAGS, Given, recipe_options


@recipe_options(*EVERY, tasks="all")
def build(
    given: Given,
    executor: common.Executor = "auto",
    workers: common.Workers = None,
    address: common.Address = None,
    gpus_per_worker: common.Gpus = None,
    runtime_env: common.RuntimeEnv = None,
    slot_timeout: Annotated[
        float,
        number(
            0.01, 1e7, "Seconds one attempt at a slot may take before its worker counts as hung."
        ),
    ] = 600.0,
    out: Annotated[
        Path, option("The dataset, a directory or URL; rerun the same command to resume.")
    ] = Path("OUT"),
    progress: Annotated[
        str, option("bar, json (one object a line on standard output, docs/cluster.md) or none.")
    ] = "bar",
    quiet: common.Quiet = False,
    yes: Annotated[
        bool,
        option(
            "Build all tasks at all default levels, if no option or manifest chooses fewer.",
            "--yes",
        ),
    ] = False,
    as_json: common.AsJson = False,
) -> None:
    """Make a dataset, or resume a build. Exit code 3 if slots were given up."""
    from pipeline.annotate.overlays import annotation_sheet
    from pipeline.report.page import refresh
    from pipeline.run.build import build as run_build
    from pipeline.run.names import check_events
    from pipeline.run.plan import check_bounded

    recipe = given.recipe()
    check_events(recipe, recipe.tasks)
    slots = sum(recipe.counts().values())
    crew = common.crew_of(executor, workers, address, gpus_per_worker, runtime_env, slots)
    if progress not in SHOWN:
        raise common.UsageError(f"--progress {progress!r} is unknown: choose {', '.join(SHOWN)}")
    kind = cast(Kind, "none" if quiet else progress)
    if not given.from_file and not yes:
        check_bounded(given.values, recipe, Dataset(out), crew.workers)
    with common.resumable(out):
        result = run_build(out, recipe, crew, slot_timeout, kind)
        refresh(Dataset(out), annotation_sheet)
    if kind == "json":
        print(json.dumps({"event": "result", **vars(result)}))
    else:
        lost = f", {result.workers_lost} workers lost and replaced" if result.workers_lost else ""
        text = (
            f"{result.accepted} of {result.slots} episodes in {out} ({result.given_up} given up,"
            f" {result.attempts} attempts in all; {result.made} slots by this run{lost}); images:"
            f" {Dataset(out).report}"
        )
        common.print_result(vars(result), as_json, text)
    if result.given_up:
        common.note(
            f"slots given up after {recipe.attempts} attempts each: {result.given_up};"
            f" `domino-data status {with_urls(str(out))}` shows why"
        )
        raise typer.Exit(common.GIVEN_UP)


@recipe_options(*EVERY, tasks="all")
def plan(
    given: Given,
    workers: common.Workers = None,
    out: Annotated[
        Path | None, option("An existing dataset to count finished slots and times from.")
    ] = None,
    measure: Annotated[
        bool,
        option(
            "Make four episodes in a temporary directory to measure how long they take here.",
            "--measure",
        ),
    ] = False,
    as_json: common.AsJson = False,
) -> None:
    """Estimate what `build` would produce: episodes, hours and bytes. Writes no files."""
    from pipeline.run import plan as planning
    from pipeline.run.names import check_events
    from pipeline.run.state import redo_lines

    recipe = given.recipe()
    check_events(recipe, recipe.tasks)
    cost = None
    if measure:
        print("measuring: four episodes, up to a minute", file=sys.stderr)
        cost = planning.measure(recipe)
    values = planning.plan(recipe, Dataset(out) if out else None, workers or usable_cores(), cost)
    wide = values["estimated_hours_most"] > values["estimated_hours"]
    lines = [
        f"tasks: {len(recipe.tasks)}, robots: {len(recipe.embodiments)}, levels:"
        f" {len(recipe.levels)}, cells: {len(values['cells'])}, episodes: {values['slots']:,}",
        f"finished: {values['finished']:,}; to make: {values['slots'] - values['finished']:,};"
        f" {values['estimate']}",
        *redo_lines(values["redo"]),
        f"core-hours: {values['estimated_core_hours']:,.1f}{' or more' * wide}",
    ]
    common.print_result(values, as_json, "\n".join(lines))


DRAWING = (
    *("cameras", "size", "render", "depth", "segmentation", "pointcloud", "sensors"),
    *("textures", "environment", "variants", "visual_seed"),
)
"""Keys of a recipe that a dataset can be drawn again with, besides `visuals`."""

VISUALS = ("keep", "clean", "randomized")


@recipe_options(*DRAWING, files=())
def render(
    given: Given,
    dataset: common.Root,
    out: Annotated[Path, option("Directory of the new dataset; rerun the same command to resume.")],
    visuals: Annotated[
        str, option("Looks of room and lights: keep the stored ones, clean or randomized.")
    ] = "keep",
    executor: common.Executor = "auto",
    workers: common.Workers = None,
    address: common.Address = None,
    gpus_per_worker: common.Gpus = None,
    runtime_env: common.RuntimeEnv = None,
    quiet: common.Quiet = False,
    as_json: common.AsJson = False,
) -> None:
    """Render a dataset again: other cameras, sizes, sensors or looks, without physics. Everything
    else stays the same."""
    from pipeline.run.render import render as run_render

    changes = with_looks(given.values, visuals)
    crew = common.crew_of(executor, workers, address, gpus_per_worker, runtime_env)
    flags = FLAGS | {"visuals": "--visuals"}
    with common.resumable(out):
        result = run_render(Dataset(dataset), Dataset(out), changes, crew, quiet=quiet, flags=flags)
    text = (
        f"{result.accepted} of {result.slots} episodes in {out} ({result.drawn} drawn by this run,"
        f" {result.given_up} given up, {result.open} not built yet in {dataset})"
    )
    lines = [text, *(f"cannot be drawn: {problem}" for problem in result.problems)]
    common.print_result(vars(result), as_json, "\n".join(lines))
    if result.problems:
        raise typer.Exit(1)


def with_looks(values: Mapping[str, Any], visuals: str) -> dict[str, Any]:
    """Keys of a recipe that the options change. Raises UsageError."""
    if visuals not in VISUALS:
        raise common.UsageError(f"--visuals {visuals!r} is unknown: choose {', '.join(VISUALS)}")
    if visuals != "randomized" and not {"variants", "visual_seed"}.isdisjoint(values):
        raise common.UsageError(
            "--variants and --visual-seed are of randomized looks: add --visuals randomized"
        )
    looks = {"visuals": visuals, "variants": 1, "visual_seed": 0}
    return dict(values) if visuals == "keep" else looks | dict(values)


NEXT = """next:
  python -c "import domino_data as dd; print(dd.open_dataset('{out}').recipe().tasks)"
  domino-data export {out} --format lerobot
  domino-data build --tasks shake_bottle --levels 1,2,3 --episodes 20 --out domino-more
  domino-data tasks    # the other tasks; every command has --help"""


def demo(
    out: Annotated[Path, option("Directory of the dataset.")] = Path("domino-demo"),
    view: Annotated[
        bool, option("Open the viewer in a browser, if there is one.", "--view/--no-view")
    ] = True,
    quiet: common.Quiet = False,
) -> None:
    """Make two episodes of a robot that catches a bottle with abrupt turns, and open them in the
    viewer. Rerun it to see them again."""
    from pipeline.annotate.overlays import annotation_sheet
    from pipeline.crew.contract import Crew
    from pipeline.data.recipe.model import parse_recipe
    from pipeline.report.page import refresh
    from pipeline.report.viewer import write_viewer
    from pipeline.run.build import build as run_build

    recipe = parse_recipe({"tasks": "shake_bottle", "levels": 3, "episodes": 2})
    with common.resumable(out):
        run_build(out, recipe, Crew(), shown="none" if quiet else "bar")
        refresh(Dataset(out), annotation_sheet)
    dataset = Dataset(out)
    episodes = sorted(dataset.accepted(dataset.recipe()))
    pages = dataset.report.parent / "view"
    page = write_viewer(dataset.root, episodes, pages, len(episodes)).resolve().as_uri()
    print(f"{len(episodes)} episodes in {out}; watch them: {page}")
    print(NEXT.format(out=out))
    if view and common.has_screen():
        webbrowser.open(page)

"""build, plan, render: make a dataset, estimate one, or draw its episodes again."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.commands import common
from pipeline.commands.options import EVERY, FLAGS, Given, recipe_options
from pipeline.data.dataset import Dataset
from pipeline.data.process.machine import usable_cores
from pipeline.data.store.place import with_urls


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
        typer.Option(
            min=0.01,
            max=1e7,
            help="Seconds one attempt at a slot may take before its worker counts as hung.",
        ),
    ] = 600.0,
    out: Annotated[
        Path,
        typer.Option(help="The dataset, a directory or URL; rerun the same command to resume."),
    ] = Path("OUT"),
    progress: Annotated[
        str,
        typer.Option(
            help="bar, json (one object a line on standard output, docs/cluster.md) or none."
        ),
    ] = "bar",
    quiet: common.Quiet = False,
    yes: Annotated[
        bool,
        typer.Option(
            "--yes",
            help="Build all tasks at all default levels, if no option or manifest chooses fewer.",
        ),
    ] = False,
    as_json: common.AsJson = False,
) -> None:
    """Make a dataset, or resume a build. Exit code 3 if slots were given up."""
    from pipeline.run.build import build as run_build
    from pipeline.run.names import check_events
    from pipeline.run.plan import check_bounded

    recipe = given.recipe()
    check_events(recipe, recipe.tasks)
    slots = sum(recipe.counts().values())
    crew = common.crew_of(executor, workers, address, gpus_per_worker, runtime_env, slots)
    kind = common.kind_of("none" if quiet else progress)
    if not given.from_file and not yes:
        check_bounded(given.values, recipe, Dataset(out), crew.workers)
    common.warn_of_pattern(out)
    with common.resumable(out):
        result = run_build(out, recipe, crew, slot_timeout, kind)
    if kind == "json":
        print(json.dumps({"event": "result", **result.__dict__}))
    else:
        lost = f", {result.workers_lost} workers lost and replaced" if result.workers_lost else ""
        counts = (
            f"{result.given_up} given up, {result.attempts} attempts in all; {result.made} slots by"
            f" this run{lost}"
        )
        text = (
            f"{result.accepted} of {result.slots} episodes in {out} ({counts}); images:"
            f" {Dataset(out).report}"
        )
        common.print_result(result.__dict__, as_json, text)
    for line in result.stopped:
        print(f"domino-data: {line}", file=sys.stderr)
    if result.given_up:
        print(
            f"domino-data: slots given up after {recipe.attempts} attempts each: {result.given_up};"
            f" `domino-data status {with_urls(str(out))}` shows why",
            file=sys.stderr,
        )
    if result.given_up or result.stopped:
        raise typer.Exit(common.GIVEN_UP)


@recipe_options(*EVERY, tasks="all")
def plan(
    given: Given,
    workers: common.Workers = None,
    out: Annotated[
        Path | None,
        typer.Option(help="An existing dataset to count finished slots and times from."),
    ] = None,
    cells: Annotated[bool, typer.Option("--cells", help="Print a row for every cell.")] = False,
    measure: Annotated[
        bool,
        typer.Option(
            "--measure",
            help="Make four episodes in a temporary directory to measure how long they take here.",
        ),
    ] = False,
    price: Annotated[
        float | None,
        typer.Option(
            min=0, max=1e9, help="Price of a core-hour, in any currency.", show_default=False
        ),
    ] = None,
    as_json: common.AsJson = False,
) -> None:
    """Estimate what `build` would produce: episodes, hours and bytes. Writes no files."""
    from pipeline.run import plan as planning
    from pipeline.run.names import check_events
    from pipeline.run.state import redo_lines

    recipe = given.recipe()
    check_events(recipe, recipe.tasks)
    count = workers or usable_cores()
    cost = None
    if measure:
        print("measuring: four episodes, up to a minute", file=sys.stderr)
        cost = planning.measure(recipe)
    values = planning.plan(recipe, Dataset(out) if out else None, count, cost, price)
    lines = []
    if cells:
        headers = ("task", "robot", "level", "alpha (m/s)", "domain", "episodes", "finished")
        names = ("task", "embodiment", "level", "alpha", "domain", "episodes", "finished")
        lines.append(
            common.table(
                headers,
                [[f"{c[n]:g}" if n == "alpha" else c[n] for n in names] for c in values["cells"]],
            )
        )
    lines.append(
        f"tasks: {len(recipe.tasks)}, robots: {len(recipe.embodiments)}, levels:"
        f" {len(recipe.levels)}, cells: {len(values['cells'])}, episodes: {values['slots']:,}"
    )
    left = values["slots"] - values["finished"]
    lines.append(f"finished: {values['finished']:,}; to make: {left:,}; {values['estimate']}")
    lines += redo_lines(values["redo"])
    costs = (
        f", {values['estimated_cost']:,.2f} at {price:g} a core-hour" if price is not None else ""
    )
    lines.append(f"core-hours: {values['estimated_core_hours']:,.1f}{costs}")
    if left and (parts := values["estimated_bytes_by_part"]):
        lines.append(
            "bytes: "
            + ", ".join(f"{name} {planning.format_size(size)}" for name, size in parts.items())
        )
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
    out: Annotated[
        Path, typer.Option(help="Directory of the new dataset; rerun the same command to resume.")
    ],
    visuals: Annotated[
        str,
        typer.Option(help="Looks of room and lights: keep the stored ones, clean or randomized."),
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
    with common.resumable(out):
        result = run_render(
            Dataset(dataset),
            Dataset(out),
            changes,
            crew,
            quiet=quiet,
            flags=FLAGS | {"visuals": "--visuals"},
        )
    lines = [
        (
            f"{result.accepted} of {result.slots} episodes in {out} ({result.drawn} drawn by this"
            f" run, {result.given_up} given up, {result.open} not built yet in {dataset})"
        ),
        *(f"cannot be drawn: {problem}" for problem in result.problems),
    ]
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
    return (
        dict(values)
        if visuals == "keep"
        else {"visuals": visuals, "variants": 1, "visual_seed": 0, **values}
    )

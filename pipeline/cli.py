"""The `domino-data` command: a thin table of verbs. Bad input ends with one line on stderr and exit code 2."""

import json
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from tqdm import tqdm

from pipeline.engine import SINGLE_THREAD, Stopped, pick_executor, stop_on_signal

# before numpy, numba or Mesa read them
for _name, _value in SINGLE_THREAD.items():
    os.environ.setdefault(_name, _value)

from pipeline.dataset import Dataset, DatasetError
from pipeline.manifest import Recipe, RecipeError, read_recipe, recipe_from

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for a program to read.")]
Root = Annotated[Path, typer.Argument(help="The dataset directory.", metavar="DATASET")]


class UsageError(Exception):
    """Bad input that no other error describes."""


def _say(values: Any, as_json: bool, text: str) -> None:
    print(json.dumps(values, indent=1) if as_json else text)


def _list(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def _numbers(text: str | None, kind: type, option: str) -> list[Any] | None:
    try:
        return None if text is None else [kind(part) for part in _list(text) or []]
    except ValueError as error:
        raise UsageError(f"{option} {text!r} is not a list of numbers like 1,2,3") from error


Manifest = Annotated[Path | None, typer.Option(help="A recipe file (YAML); options given beside it override its keys.")]
Tasks = Annotated[str | None, typer.Option(help="Task names, comma separated, or `all`.")]
Embodiment = Annotated[str | None, typer.Option(help="Robot names, comma separated; a pair is written left+right.")]
Levels = Annotated[str | None, typer.Option(help="Levels, comma separated: 0 static, 1 constant velocity, 2 polynomial, 3 abrupt.")]
Domains = Annotated[str | None, typer.Option(help="clean, randomized or both.")]
Alpha = Annotated[str | None, typer.Option(help="Speed coefficients in m/s, comma separated.")]
Episodes = Annotated[int | None, typer.Option(help="Episodes per cell.")]
Seed = Annotated[int | None, typer.Option(help="Seed of the recipe.")]
Attempts = Annotated[int | None, typer.Option(help="Seeds tried for one slot before it is given up.")]
Render = Annotated[str | None, typer.Option(help="raster, raster-fast or rt.")]
Executor = Annotated[str, typer.Option(help="inline, ray or auto.")]
Workers = Annotated[int | None, typer.Option(help="Worker processes; all cores by default.")]


def _recipe(
    manifest: Path | None,
    tasks: str | None,
    embodiment: str | None,
    levels: str | None,
    domains: str | None,
    alpha: str | None,
    episodes: int | None,
    seed: int | None,
    attempts: int | None = None,
    render: str | None = None,
) -> Recipe:
    values = read_recipe(manifest) if manifest else {}
    given = {
        "tasks": _list(tasks),
        "embodiments": _list(embodiment),
        "levels": _numbers(levels, int, "--levels"),
        "domains": _list(domains),
        "alpha": _numbers(alpha, float, "--alpha"),
        "episodes": episodes,
        "seed": seed,
        "attempts": attempts,
        "render": render,
    }
    source = str(manifest) if manifest else "options"
    return recipe_from(values | {key: value for key, value in given.items() if value is not None}, source)


def _executor(name: str, workers: int | None) -> tuple[str, int]:
    from pipeline.engine import EXECUTORS

    if name not in EXECUTORS:
        raise UsageError(f"--executor {name!r} is unknown: choose {', '.join(EXECUTORS)}")
    if workers is not None and workers < 1:
        raise UsageError(f"--workers {workers} is not a number of workers: give 1 or more")
    return pick_executor(name, workers)


@app.command()
def build(
    manifest: Manifest = None,
    tasks: Tasks = None,
    embodiment: Embodiment = None,
    levels: Levels = None,
    domains: Domains = None,
    alpha: Alpha = None,
    episodes: Episodes = None,
    seed: Seed = None,
    attempts: Attempts = None,
    render: Render = None,
    executor: Executor = "auto",
    workers: Workers = None,
    out: Annotated[Path, typer.Option(help="The dataset directory; the same command again goes on where it stopped.")] = Path(
        "OUT"
    ),
    quiet: Annotated[bool, typer.Option(help="No progress bar.")] = False,
    as_json: AsJson = False,
) -> None:
    """Make a dataset, or go on making it."""
    from pipeline.build import build as run_build

    recipe = _recipe(manifest, tasks, embodiment, levels, domains, alpha, episodes, seed, attempts, render)
    name, count = _executor(executor, workers)
    stop_on_signal()
    try:
        result = run_build(out, recipe, name, count, quiet)
    except Stopped:
        print(f"stopped; what is finished is in {out}, the same command goes on", file=sys.stderr)
        raise typer.Exit(130) from None
    _say(
        result.__dict__,
        as_json,
        f"{result.accepted} of {result.slots} episodes in {out} ({result.made} slots worked on now, {result.given_up} given up, "
        f"{result.attempts} attempts); pictures: {Dataset(out).report}",
    )


@app.command()
def plan(
    manifest: Manifest = None,
    tasks: Tasks = None,
    embodiment: Embodiment = None,
    levels: Levels = None,
    domains: Domains = None,
    alpha: Alpha = None,
    episodes: Episodes = None,
    seed: Seed = None,
    workers: Workers = None,
    out: Annotated[Path | None, typer.Option(help="An existing dataset to count finished slots and times from.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say what `build` would make, how long it takes and how big it gets. Writes nothing."""
    from pipeline.plan import plan as run_plan

    recipe = _recipe(manifest, tasks, embodiment, levels, domains, alpha, episodes, seed)
    _, count = _executor("ray", workers)
    values = run_plan(recipe, Dataset(out) if out else None, count)
    lines = [
        f"{c['task']:28} {c['embodiment']:14} L{c['level']} alpha {c['alpha']:g} {c['domain']:10} "
        f"{c['finished']:5} of {c['episodes']}"
        for c in values["cells"]
    ]
    lines.append(
        f"{len(values['cells'])} cells, {values['slots']} slots, {values['finished']} finished; about "
        f"{values['estimated_hours']:.2f} h on {count} workers and {values['estimated_bytes'] / 1e9:.2f} GB "
        f"(from {values['estimate_from']})"
    )
    _say(values, as_json, "\n".join(lines))


@app.command()
def status(dataset: Root, as_json: AsJson = False) -> None:
    """Say what a dataset holds and what went wrong."""
    from pipeline.plan import status as run_status

    values = run_status(Dataset(dataset))
    lines = [
        f"{path:60} {c['accepted']:5} of {c['wanted']:5}, {c['given_up']} given up, {c['attempts']} attempts"
        for path, c in values["cells"].items()
    ]
    reasons = ", ".join(f"{reason} {n}" for reason, n in values["reasons"].items()) or "none"
    rate = values["attempt_success"]
    lines.append(
        f"{values['accepted']} of {values['wanted']} accepted, {values['given_up']} given up, {values['open']} open; "
        f"{values['attempts']} attempts" + (f", {100 * rate:.0f} % succeed" if rate is not None else "") + f"; failures: {reasons}"
    )
    _say(values, as_json, "\n".join(lines))


@app.command()
def verify(dataset: Root, as_json: AsJson = False) -> None:
    """Check everything that a dataset promises; exit code 1 when something does not hold."""
    from pipeline.verify import verify as run_verify

    values = run_verify(Dataset(dataset))
    lines = [f"{'ok  ' if c['ok'] else 'FAIL'} {c['name']}: {c['detail']}" for c in values["checks"]]
    _say(values, as_json, "\n".join(lines))
    if not values["ok"]:
        raise typer.Exit(1)


@app.command()
def export(
    dataset: Root,
    format_: Annotated[str, typer.Option("--format", help="lerobot, aloha or parquet.")],
    out: Annotated[Path | None, typer.Option(help="Where to write; DATASET/exports/NAME by default.")] = None,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Write a dataset in another format."""
    from pipeline.export import EXPORTERS

    source = Dataset(dataset)
    if format_ not in EXPORTERS:
        raise UsageError(f"--format {format_!r} is unknown: choose {', '.join(EXPORTERS)}")
    recipe = source.recipe()
    episodes = [source.episode(slot) for slot, record in source.records(recipe) if record.accepted]
    if not episodes:
        raise UsageError(f"{dataset} has no finished episodes to export")
    place = out or source.exports(format_)
    speed = {"workers": pick_executor("ray", workers)[1]} if format_ == "lerobot" else {}
    with tqdm(total=len(episodes), unit="ep", disable=as_json or None) as bar:
        values = EXPORTERS[format_](dataset, place, sorted(episodes), progress=bar.update, **speed)
    _say(values, as_json, f"{len(episodes)} episodes written to {place}")


@app.command()
def tasks(as_json: AsJson = False) -> None:
    """List the tasks."""
    from pipeline.tasks.listing import listing

    values = listing()
    text = "\n".join(f"{t['name']:26} {t['category']:13} limit {t['step_limit']:5}  {', '.join(t['objects'])}" for t in values)
    _say(values, as_json, text)


@app.command()
def embodiments(as_json: AsJson = False) -> None:
    """List the robots."""
    from pipeline.world.robots.listing import listing

    values = listing()
    _say(values, as_json, "\n".join(f"{e['name']:14} {e['dof']} dof, cameras {', '.join(e['cameras'])}" for e in values))


def main() -> None:
    """Entry point: run the command and turn every expected error into one line and exit code 2."""
    from pipeline.episode import EpisodeError
    from pipeline.export.common import ExportError
    from pipeline.world.vulkan import NoRenderer

    try:
        app(standalone_mode=True)
    except (UsageError, RecipeError, DatasetError, EpisodeError, ExportError, NoRenderer) as error:
        print(f"domino-data: {error}", file=sys.stderr)
        sys.exit(2)
    except OSError as error:
        print(f"domino-data: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
        sys.exit(2)

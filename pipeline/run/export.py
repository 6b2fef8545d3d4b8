"""`domino-data export`: intact episodes, or kept failures, in another format."""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tqdm import tqdm

from pipeline.data.dataset import Dataset
from pipeline.data.intact import intact_episodes, intact_failures
from pipeline.data.recipe.model import Recipe
from pipeline.data.slots.select import VALIDATION, attempts_of, expression
from pipeline.data.store.place import replace_directory
from pipeline.export import EXPORTERS, ExportError, Job, parse_options
from pipeline.export.exporter import LEFT_OUT
from pipeline.export.options import flag_name
from pipeline.export.shared.episodes import EPISODES, FAILURES, select_episodes
from pipeline.export.shared.record import read_record
from pipeline.report.card import describe

from .identity.core import shared_physics
from .joined import DatasetPart, join, weigh

JOINED = ("lerobot", "lerobot-v2.1", "rlds", "zarr")
CORRECTED = ("lerobot", "parquet")  # formats whose frames say who acted


@dataclass(frozen=True)
class Request:
    """What to export: the format, its options by field name, and which episodes. `split` is
    EPISODES or FAILURES; `validation` is a share. `also` are further datasets, each with its part
    by `weights` or with all episodes; then `out` must be given. `fps` resamples
    (data/episode/resample.py)."""

    format: str
    options: Mapping[str, str | bool] = field(default_factory=dict)
    out: Path | None = None
    split: str = EPISODES
    robots: Sequence[str] = ()
    where: str | None = None
    validation: float = VALIDATION
    also: Sequence[Dataset] = ()
    weights: Sequence[float] = ()
    fps: int | None = None


@dataclass(frozen=True)
class Export:
    """An export; `warning` is about sensors and stale episodes, or ""."""

    summary: Mapping[str, Any]
    place: Path
    episodes: int
    warning: str


def export(source: Dataset, request: Request, workers: int = 1, progress: bool = False) -> Export:
    """Write the export; an old one is replaced at the end. Raises ExportError, DatasetError,
    WhereError.
    """
    if request.format not in EXPORTERS:
        raise ExportError(f"--format {request.format!r} is unknown: choose {', '.join(EXPORTERS)}")
    exporter, failures = EXPORTERS[request.format], request.split == FAILURES
    options = parse_options(request.format, exporter.options, request.options)
    datasets = [source, *request.also]
    recipes = [dataset.recipe() for dataset in datasets]
    _check_join(request, recipes)
    fits, parts = "", list[DatasetPart]()
    for dataset, recipe in zip(datasets, recipes, strict=True):
        fits = expression(request.where, _robots(request.robots, recipe))
        attempts = partial(attempts_of, dataset.attempt_rows)
        found = sorted(_intact(dataset, recipe, failures))
        chosen = select_episodes(found, fits, request.validation, attempts)
        parts.append(DatasetPart(dataset, chosen))
    if request.weights:
        parts = weigh(parts, request.weights)
    episodes = [path for part in parts for path in part.episodes]
    name = f"{request.format}-failures" if failures else request.format
    place = request.out or source.exports(name)
    with (
        tqdm(total=len(episodes), unit="ep", disable=None if progress else True) as bar,
        ExitStack() as stack,
    ):
        job = Job(
            source.root,
            place,
            episodes,
            options,
            bar.update,
            workers,
            None if request.also else describe(source.root, episodes),
            split=request.split,
            where=fits,
            validation=request.validation,
        )
        if request.also or request.fps:
            place.parent.mkdir(parents=True, exist_ok=True)
            folder = TemporaryDirectory(dir=place.parent, prefix=".joined-")
            root = Path(stack.enter_context(folder))
            made = join(parts, root, request.fps)
            given: dict[str, Any] = {"fps": request.fps} if request.fps else {}
            if request.also:
                given |= {"datasets": len(datasets), "weights": list(request.weights)}
            job = replace(job, dataset=root, episodes=list(made), origins=made, given=given)
        stack.enter_context(replace_directory(place))
        summary = exporter.export(job)
    warnings = [] if failures else [stale_warning(source, recipes[0])]
    if left := summary.get(LEFT_OUT):
        warnings.insert(0, left_out_warning(request.format, left, exporter.options))
    return Export(summary, place, len(episodes), "; ".join(filter(None, warnings)))


def _check_join(request: Request, recipes: Sequence[Recipe]) -> None:
    """Raise ExportError for datasets that cannot be joined."""
    if request.also and request.format not in JOINED:
        raise ExportError(
            f"--format {request.format} holds one dataset: several need {', '.join(JOINED)}"
        )
    if request.also and request.out is None:
        raise ExportError("several datasets need --out: their export belongs to none of them")
    if any(weight <= 0 for weight in request.weights):
        raise ExportError("--weights: each must be above 0")
    if request.weights and len(request.weights) != len(recipes):
        raise ExportError(
            f"--weights has {len(request.weights)} numbers for {len(recipes)} datasets"
        )
    if request.format not in CORRECTED and any(recipe.corrections for recipe in recipes):
        raise ExportError(
            f"--format {request.format} cannot say which actions are the policy's: corrections need"
            f" {', '.join(CORRECTED)}"
        )


def differences(source: Dataset, place: Path) -> list[str]:
    """How the export at `place` differs from what it should hold, a line each. Raises
    ExportError, DatasetError.
    """
    record = read_record(place)
    summary, attempts = record.summary, partial(attempts_of, source.attempt_rows)
    episodes = sorted(_intact(source, source.recipe(), summary["split"] == FAILURES))
    where, validation = summary.get("where", ""), summary.get("validation", VALIDATION)
    return record.check(source.root, select_episodes(episodes, where, validation, attempts))


def stale_warning(source: Dataset, recipe: Recipe) -> str:
    """How many episodes older code made; "" for none."""
    rows, now = source.present(recipe), shared_physics().items()
    stale = [
        number
        for number, text in rows.texts.items()
        if not now <= json.loads(text).get("physics", {}).items()
    ]
    if not (count := int(np.isin(rows.keys[rows.accepted], stale).sum())):
        return ""
    return (
        f"{count} episodes were made by another version of the code and are exported as they are;"
        f" `domino-data status {source.root}` shows what changed"
    )


def left_out_warning(format_: str, left: Sequence[str], options: type[Any]) -> str:
    """The sensors a format did not write, and the options that do."""
    flags = {f.name: flag_name(f) for f in fields(options) if f.name in left}
    none = [name for name in left if name not in flags]
    parts = [f"has no place for the episodes' {', '.join(none)}"] if none else []
    parts += [f"writes their {name} only with {flag}" for name, flag in flags.items()]
    return f"--format {format_} {' and '.join(parts)}"


def _intact(source: Dataset, recipe: Recipe, failures: bool) -> list[Path]:
    """Episodes or kept failures, each read. Raises ExportError for none."""
    if found := (intact_failures if failures else intact_episodes)(source, recipe):
        return found
    if failures:
        raise ExportError(
            f"{source.root} keeps no failed attempts: its recipe has keep_failures:"
            f" {recipe.keep_failures}, or none failed"
        )
    raise ExportError(
        f"{source.root} has no finished episodes to export: `domino-data build` makes them"
    )


def _robots(wanted: Sequence[str], recipe: Recipe) -> list[str]:
    """The wanted robots. Raises ExportError for an unknown one."""
    robots = [name if name in recipe.embodiments else _name_of_alias(name) for name in wanted]
    if missing := [name for name in robots if name not in recipe.embodiments]:
        raise ExportError(
            f"--embodiment {missing[0]}: the dataset has only {', '.join(recipe.embodiments)}"
        )
    return robots


def _name_of_alias(alias: str) -> str:
    # it takes a second, and most exports name no robot by its alias
    from pipeline.world.robots import canonical_name

    return canonical_name(alias)

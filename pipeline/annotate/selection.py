"""Which stages and episodes are to be annotated."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError, open_episode
from pipeline.data.slots.select import attempts_of, columns_of, parse_where, select_rows, values_in

from .flow_stage import FlowStage
from .model_stages import FeatureStage, MaskStage
from .networks.models import NoWeights, resolve
from .options import AnnotateOptions
from .stage import AnnotateError, Redraw, Stage
from .store import episode_paths
from .world_stage import WorldStage

STAGES = ("flow", "masks", "features", "world")

DEFAULT_STAGES = STAGES[:3]


@dataclass(frozen=True)
class Absent:
    """A stage that a dry run cannot make because weights are missing, and which."""

    name: str
    camera: str
    reason: str


def build_stages(
    options: AnnotateOptions,
    stages: Sequence[str],
    redraw: Redraw,
    device: str = "auto",
    dry_run: bool = False,
) -> list[Stage | Absent]:
    """Stages in order, one per camera; a dry run downloads nothing. Raises AnnotateError,
    NoWeights."""
    unknown = ", ".join(s for s in stages if s not in STAGES)
    if unknown or not stages:
        known = ", ".join(STAGES)
        raise AnnotateError(f"stage {unknown or '(none)'} is unknown: stages are {known}")
    built = list[Stage | Absent]()

    def build(name: str, camera: str) -> Stage:
        if name == "world":
            return WorldStage(options.world, camera, redraw.truth)
        if name == "flow":
            return FlowStage(options.flow, camera, redraw.render)
        masks = MaskStage(options.masks, camera, redraw.render, device).resolve(not dry_run)
        if name == "masks":
            return masks
        encoder = resolve(options.features.encoder, not dry_run)
        return FeatureStage(options.features, masks, encoder, device)

    for name in (name for name in STAGES if name in stages):
        for camera in options.cameras:
            try:
                built.append(build(name, camera))
            except NoWeights as error:
                if not dry_run:
                    raise
                built.append(Absent(name, camera, str(error)))
    return built


def select_episodes(dataset: Path, where: str | None) -> list[Path]:
    """Episodes that `where` selects, and unreadable ones. Raises WhereError, AnnotateError for
    none."""
    paths = episode_paths(dataset)
    if where is None:
        return paths
    expression = parse_where(where)
    columns, attempts = dict[Path, dict[str, Any]](), attempts_of(Dataset(dataset).attempt_rows)
    for path in paths:
        try:
            with open_episode(dataset / "episodes" / path) as e:
                columns[path] = columns_of(e, attempts)
        except EpisodeError:
            continue
    rows = list(columns.values())
    selected = zip(columns, select_rows(rows, expression), strict=True)
    chosen = {path for path, is_selected in selected if is_selected}
    if columns and not chosen:
        held = values_in(rows, where)
        raise AnnotateError(f"no episode fits --where {where!r}" + (held and f": {held}"))
    return [path for path in paths if path in chosen or path not in columns]

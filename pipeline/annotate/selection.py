"""What is to be annotated: how each stage is made from options, and the episodes of a `where`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.annotate.feature_stage import FeatureStage
from pipeline.annotate.flow_stage import FlowStage
from pipeline.annotate.mask_stage import MaskStage
from pipeline.annotate.networks.models import NoWeights
from pipeline.annotate.options import AnnotateOptions
from pipeline.annotate.stage import Redraw, Stage
from pipeline.annotate.stage_key import AnnotateError
from pipeline.annotate.store import episode_paths
from pipeline.annotate.world_stage import WorldStage
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeError, open_episode
from pipeline.data.slots.select import attempts_of, columns_of, parse_where, select_rows, values_in

STAGES = ("flow", "masks", "features", "world")
"""The stages in the order in which they run."""

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
    """Stages in the order they must run, one per camera. A dry run downloads nothing; a stage whose
    model is missing is Absent. Raises AnnotateError, or NoWeights."""
    unknown = [s for s in stages if s not in STAGES]
    if unknown or not stages:
        raise AnnotateError(
            f"stage {', '.join(unknown) or '(none)'} is unknown: stages are {', '.join(STAGES)}"
        )
    built = list[Stage | Absent]()
    for name in (name for name in STAGES if name in stages):
        for camera in options.cameras:
            try:
                built.append(_build(name, options, camera, redraw, device, not dry_run))
            except NoWeights as error:
                if not dry_run:
                    raise
                built.append(Absent(name, camera, str(error)))
    return built


def _build(
    name: str,
    options: AnnotateOptions,
    camera: str,
    redraw: Redraw,
    device: str,
    download: bool,
) -> Stage:
    if name == "world":
        return WorldStage(options.world, camera, redraw.truth)
    if name == "flow":
        return FlowStage(options.flow, camera, redraw.render)
    masks = MaskStage.resolve(options.masks, camera, redraw.render, device, download)
    if name == "masks":
        return masks
    return FeatureStage.resolve(options.features, masks, device, download)


def select_episodes(dataset: Path, where: str | None) -> list[Path]:
    """Episodes that a `where` selects, and files that cannot be read, which are to be reported.
    Raises WhereError, and AnnotateError if it selects none."""
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
    chosen = {
        path
        for path, is_selected in zip(
            columns, select_rows(list(columns.values()), expression), strict=True
        )
        if is_selected
    }
    if columns and not chosen:
        held = values_in(list(columns.values()), where)
        raise AnnotateError(f"no episode fits --where {where!r}" + (held and f": {held}"))
    return [path for path in paths if path in chosen or path not in columns]

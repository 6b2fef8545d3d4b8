"""What is to be annotated: how each stage is made from options, and the episodes of a `where`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.annotate.feature_stage import FeatureStage
from pipeline.annotate.flow_stage import FlowStage
from pipeline.annotate.mask_stage import MaskStage
from pipeline.annotate.networks.models import NoWeights
from pipeline.annotate.options import AnnotateOptions
from pipeline.annotate.stage import Render, Stage
from pipeline.annotate.stage_key import AnnotateError
from pipeline.annotate.store import episode_paths
from pipeline.data.episode.file import EpisodeError, open_episode
from pipeline.data.select import fields_of, parse_where, select_rows
from pipeline.registry import Registry


@dataclass(frozen=True)
class StageRequest:
    """What a stage is made for: the options of all stages, the camera, how to render again, the
    device of its models, and whether it may download them."""

    options: AnnotateOptions
    camera: str
    render: Render | None
    device: str
    download: bool


@dataclass(frozen=True)
class Absent:
    """A stage that a dry run cannot make because weights are missing, and which."""

    name: str
    camera: str
    reason: str


STAGES = Registry[Callable[[StageRequest], Stage]]("stage")
"""How each stage is made, in the order in which they run. A builder raises NoWeights for a model
that is missing."""


def _masks(of: StageRequest) -> MaskStage:
    return MaskStage.resolve(of.options.masks, of.camera, of.render, of.device, of.download)


STAGES.add("flow", lambda of: FlowStage(of.options.flow, of.camera, of.render))
STAGES.add("masks", _masks)
STAGES.add(
    "features",
    lambda of: FeatureStage.resolve(of.options.features, _masks(of), of.device, of.download),
)


def build_stages(
    options: AnnotateOptions, stages: Sequence[str], render: Render | None, device: str = "auto"
) -> list[Stage]:
    """Stages in the order they must run, one per camera. Raises AnnotateError for an unknown stage,
    NoWeights."""
    return [build() for _, _, build in _builders(options, stages, render, device, True)]


def build_for_dry_run(
    options: AnnotateOptions, stages: Sequence[str], render: Render | None, device: str = "auto"
) -> list[Stage | Absent]:
    """As `build_stages`, downloading nothing; a stage whose model is missing is Absent."""
    built: list[Stage | Absent] = []
    for name, camera, build in _builders(options, stages, render, device, False):
        try:
            built.append(build())
        except NoWeights as error:
            built.append(Absent(name, camera, str(error)))
    return built


def _builders(
    options: AnnotateOptions,
    stages: Sequence[str],
    render: Render | None,
    device: str,
    download: bool,
) -> list[tuple[str, str, Callable[[], Stage]]]:
    """Name, camera and builder of each stage, in the order they must run."""
    unknown = [s for s in stages if s not in STAGES]
    if unknown or not stages:
        raise AnnotateError(
            f"stage {', '.join(unknown) or '(none)'} is unknown: stages are {', '.join(STAGES)}"
        )
    requests = [
        StageRequest(options, camera, render, device, download) for camera in options.cameras
    ]
    return [
        (name, of.camera, partial(STAGES[name], of))
        for name in STAGES
        if name in stages
        for of in requests
    ]


def select_episodes(dataset: Path, where: str | None) -> list[Path]:
    """Episodes of a dataset that a `where` expression selects; files that cannot be read are kept,
    so that they are reported."""
    expression = parse_where(where or "")
    paths = episode_paths(dataset)
    if not where:
        return paths
    fields = dict[Path, dict[str, Any]]()
    for path in paths:
        try:
            with open_episode(dataset / "episodes" / path) as e:
                fields[path] = fields_of(e.spec, e.meta)
        except EpisodeError:
            continue
    chosen = {
        path
        for path, is_selected in zip(
            fields, select_rows(list(fields.values()), expression), strict=True
        )
        if is_selected
    }
    return [path for path in paths if path in chosen or path not in fields]

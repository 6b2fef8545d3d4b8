"""Episodes of several datasets, or at another rate, in a directory for an export."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.data.atomic import link
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.frames import encode_frames
from pipeline.data.episode.resample import frames_at, resample_log
from pipeline.data.episode.writer import write_episode
from pipeline.data.keys import digest
from pipeline.data.slots.assets import AssetStore
from pipeline.export import ExportError
from pipeline.export.shared.episodes import reading
from pipeline.motion.models import motion_from_json
from pipeline.motion.recorded import Interception, conditions_of, physics_arrays


@dataclass(frozen=True)
class DatasetPart:
    """A dataset, and those of its episodes that are exported, in order."""

    dataset: Dataset
    episodes: Sequence[Path]


def weigh(sources: Sequence[DatasetPart], weights: Sequence[float]) -> list[DatasetPart]:
    """As many episodes of each robot as keep the weights. Raises ExportError for a missing robot.

    A hash of the physics chooses, so a smaller share is part of a larger one.
    """
    chosen: list[list[Path]] = [[] for _ in sources]
    held = [by_robot(source.episodes) for source in sources]
    for robot in sorted(set().union(*held)):
        for source, robots in zip(sources, held, strict=True):
            if robot not in robots:
                raise ExportError(
                    f"--weights: {source.dataset.root} has no {robot}, whose shares are to hold:"
                    " name robots that all have with --embodiment"
                )
        most = min(len(one[robot]) / w for one, w in zip(held, weights, strict=True))
        for kept, robots, weight in zip(chosen, held, weights, strict=True):
            kept += robots[robot][: max(1, int(most * weight + 1e-9))]
    return [replace(s, episodes=sorted(c)) for s, c in zip(sources, chosen, strict=True)]


def by_robot(episodes: Sequence[Path]) -> dict[str, list[Path]]:
    """The episodes of each robot, in the order of a hash of their physics."""
    found = list[tuple[str, str, Path]]()
    for path in episodes:
        with reading(path) as file:
            place = digest([file.meta.physics_id or file.spec.to_json()])
            found.append((file.spec.embodiment, place, path))
    robots: dict[str, list[Path]] = {}
    for robot, _, path in sorted(found):
        robots.setdefault(robot, []).append(path)
    return robots


def join(sources: Sequence[DatasetPart], root: Path, fps: int | None) -> dict[Path, Path]:
    """Make the episodes in `root`, at `fps` if given, by original. Raises ExportError for a rate
    that does not divide the physics rate.
    """
    names = [source.dataset.root.resolve().name for source in sources]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ExportError(
            f"two datasets have the name {min(twice)!r}, which tells them apart: rename one"
        )
    made = dict[Path, Path]()
    for source, name in zip(sources, names, strict=True):
        folder = root / name if len(sources) > 1 else root
        for path in source.episodes:
            place = folder / path.relative_to(source.dataset.root)
            if fps is None:
                link(path, place)
            else:
                _resample(source.dataset, path, place, fps)
            made[place] = path
    return made


def _resample(dataset: Dataset, path: Path, place: Path, fps: int) -> None:
    """Write an episode at `fps`; images off its frames are drawn again."""
    # the renderer, which an export at the dataset's own rate does without
    from pipeline.stages.drawing.render import capture, stored_appearance

    from .slot.make import stored_images

    with EpisodeFile(path) as file:
        episode, images = file.read(), stored_images(file)
    meta, drawing = episode.meta, episode.meta.drawing
    if meta.fps == fps:
        return link(path, place)
    try:
        at = frames_at(len(episode.log), meta.fps, fps)
    except ValueError as error:
        raise ExportError(f"--fps {fps}: {error}") from error
    log, rows = resample_log(episode.log, meta.fps, fps), np.floor(at).astype(int)
    if drawing.latency and drawing.sensors is not None:  # in frames of the new rate
        late = {"latency": drawing.latency * fps / meta.fps}
        sensors = drawing.sensors.model_copy(update=late)
        drawing = drawing.model_copy(update={"sensors": sensors})
    limit = round(meta.step_limit * fps / meta.fps)
    meta = meta.model_copy(update={"fps": fps, "step_limit": limit, "drawing": drawing})
    derived = Interception(meta, log, motion_from_json(episode.motion))
    conditions = conditions_of(episode.interception)
    arrays = physics_arrays(derived, {name: holds[rows] for name, holds in conditions.items()})
    new = replace(episode, log=log, meta=meta, interception=arrays)
    if (at == rows).all():
        views = [
            replace(
                view,
                poses=view.poses[rows],
                depth=None if view.depth is None else view.depth[rows],
                segmentation=None if view.segmentation is None else view.segmentation[rows],
            )
            for view in images.views
        ]
        coded = [frames[rows] for frames in images.coded]
        cloud = None if images.pointcloud is None else images.pointcloud[rows]
    else:
        appearance = stored_appearance(new, AssetStore(dataset.bodies))
        captured = capture(appearance, log, dataset.recipe())
        views, cloud = captured.views, captured.pointcloud
        coded = [encode_frames(view.rgb) for view in views]
    write_episode(place, new, views, coded, cloud)

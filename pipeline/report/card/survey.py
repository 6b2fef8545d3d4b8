"""What a card is about: one observation an episode, read from the exported files."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.cameras import CameraType, intrinsics
from pipeline.data.episode.file import Episode, open_episode
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.names import exported_names
from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec
from pipeline.html import table
from pipeline.motion.models import motion_from_json
from pipeline.motion.recorded import TRACKS, before_meeting, is_hidden, is_unoccluded
from pipeline.poses import Floats, Floats32


@dataclass(frozen=True, eq=False)
class SurveyedEpisode:
    """The facts of one episode that a card uses.

    Its target moves from `start` (s) on `path` (N,2) m at `speeds` (N,) m/s until the meeting;
    `low` and `high` (A,) bound its actions. `visible` (T,) by camera is the unoccluded share of the
    target's silhouette.
    """

    file: Path
    spec: EpisodeSpec
    meta: EpisodeMeta
    motion: str
    start: float
    frames: int
    seconds: float
    names: tuple[str, ...]
    cameras: tuple[str, ...]
    path: Floats
    speeds: Floats
    low: Floats
    high: Floats
    visible: dict[str, Floats32]
    last_visible: dict[str, Floats32]

    @property
    def level(self) -> tuple[str, int]:
        return self.motion, self.spec.level

    @property
    def cell(self) -> Cell:
        return Cell.of(self.spec)


def look(file: Path) -> SurveyedEpisode:
    with open_episode(file) as e:
        episode = e.read()
    motion, visible, log = motion_from_json(episode.motion), _visible(episode), episode.log
    times = np.linspace(-motion.lead, motion.duration, 30)
    return SurveyedEpisode(
        file=file,
        spec=episode.spec,
        meta=episode.meta,
        motion=motion.model,
        start=-motion.lead,
        frames=len(log),
        seconds=len(log) / episode.meta.fps,
        names=tuple(log.vector_names),
        cameras=episode.cameras,
        path=motion.pose(times)[:, :2],
        speeds=np.linalg.norm(motion.twist(times)[:, :3], axis=1),
        low=log.action.min(0),
        high=log.action.max(0),
        visible=visible,
        last_visible={camera: before_meeting(log, shares) for camera, shares in visible.items()},
    )


def _visible(episode: Episode) -> dict[str, Floats32]:
    """Shares (T,) of the target's silhouette that are seen, by camera."""
    meta, shares = episode.meta, dict[str, Floats32]()
    column = [name for name in meta.objects if name not in meta.clutter].index(meta.target)
    for camera in episode.cameras:
        stored = episode.interception.get(f"{TRACKS}{camera}/visible")
        if stored is not None:
            shares[camera] = stored[:, column]
    return shares


def by_cell(seen: Sequence[SurveyedEpisode]) -> dict[Cell, list[SurveyedEpisode]]:
    """Episodes by cell, in the order of the cells' paths."""
    cells: dict[Cell, list[SurveyedEpisode]] = defaultdict(list)
    for one in seen:
        cells[one.cell].append(one)
    return dict(sorted(cells.items(), key=lambda item: item[0].path))


def visibility(seen: Sequence[SurveyedEpisode], names: Mapping[str, str]) -> str:
    """How much of the target the cameras see; "" if no episode states it."""
    rows = []
    for camera, name in names.items():
        tracked = [one for one in seen if camera in one.visible]
        if not tracked:
            continue
        shares = np.concatenate([one.visible[camera] for one in tracked])
        lasts = [one.last_visible[camera] for one in tracked]
        hidden = np.mean([is_hidden(last) for last in lasts])
        rejected = np.mean([not is_unoccluded(last) for last in lasts])
        values = (*np.quantile(shares, (0.1, 0.5, 0.9)), hidden, rejected)
        rows.append([name, *(f"{100 * value:.0f}" for value in values)])
    head = (
        "camera | visible share, 10th percentile of the frames (%) | median (%) |"
        " 90th percentile (%) | episodes that hide the target (%) |"
        " episodes that `view: unoccluded` rejects (%)"
    )
    return table(head, rows) if rows else ""


def camera_names(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> Mapping[str, str]:
    """The cameras as the export calls them, by their names in an episode."""
    stored = seen[0].cameras
    names = {camera: camera for camera in stored}
    if summary["format"] not in ("robotwin", "dynamicwam", "puma-gt"):
        names = dict(exported_names(stored, summary["options"].get("camera_names", {})))
    return names | summary.get("cameras", {})


def cameras(seen: Sequence[SurveyedEpisode], summary: Mapping[str, Any]) -> str:
    names, robots = camera_names(seen, summary), defaultdict[tuple[str, ...], list[str]](list)
    for robot, one in sorted({one.spec.embodiment: one for one in reversed(seen)}.items()):
        for camera in one.cameras:
            info = one.meta.drawing.cameras[camera]
            focal = intrinsics(CameraType(info.width, info.height, info.fovy))[0, 0]
            size, link = f"{info.width} x {info.height}", info.link or "fixed in the world"
            lens = (f"{info.fovy:g}", f"{focal:.1f}")
            robots[(names.get(camera, camera), size, *lens, link)].append(robot)
    head = (
        "camera | pixels | vertical field of view (degrees) | focal length (pixels) | carried by |"
        " robots"
    )
    return table(head, [[*row, ", ".join(carriers)] for row, carriers in sorted(robots.items())])

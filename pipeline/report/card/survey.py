"""What a card is about: one observation an episode, read from the files that are exported."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CameraType, visible
from pipeline.data.episode.file import Episode, open_episode
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.models import motion_from_json
from pipeline.motion.recorded import TRACKS, before_meeting

STILL = 1e-3
"""rad, or share of a gripper's opening; frames with smaller changes of the command count as
still."""


@dataclass(frozen=True, eq=False)
class SurveyedEpisode:
    """The facts of one episode that a card uses.

    `motion` is the model of its target's motion, which begins at `start` (s), `path` (N,2) that
    motion in x and y (m) until the meeting, `speeds` (N,) its speed there (m/s); `low` and `high`
    (A,) bound its actions. `target_in_view` (T,) is true, by fixed camera, in the frames whose
    image contains the origin of the target, occluded or not. `visible` (T,) is, by camera, the
    share of the target's silhouette that is in the image and not occluded, `last_visible` that of
    the frames just before the meeting; both are empty for episodes without tracks. `after_success`
    counts the frames after the success, `still` those over which no command changes by more than
    STILL.
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
    sizes: dict[str, tuple[int, int]]
    path: NDArray[np.float64]
    speeds: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    instructions: tuple[tuple[str, ...], tuple[str, ...]]
    target_in_view: dict[str, NDArray[np.bool_]]
    visible: dict[str, NDArray[np.float32]]
    last_visible: dict[str, NDArray[np.float32]]
    after_success: int
    still: int

    @property
    def level(self) -> tuple[str, int]:
        """Model and level of its target's motion."""
        return self.motion, self.spec.level

    @property
    def cell(self) -> Cell:
        """The cell that it belongs to."""
        s = self.spec
        return Cell(s.task, s.embodiment, s.level, s.alpha, s.domain)


def look(file: Path) -> SurveyedEpisode:
    """Read one episode without its images. Raises EpisodeError if it cannot be read."""
    with open_episode(file) as e:
        episode = e.read()
        infos = e.meta.drawing.cameras
        sizes = {name: (c.width, c.height) for name, c in infos.items()}
    motion = motion_from_json(episode.motion)
    visible_shares = _visible(episode)
    success = episode.log.time_of("success")
    times = np.linspace(-motion.lead, motion.duration, 30)
    action = episode.log.action
    return SurveyedEpisode(
        file=file,
        spec=episode.spec,
        meta=episode.meta,
        motion=motion.model,
        start=-motion.lead,
        frames=len(episode.log),
        seconds=len(episode.log) / episode.meta.fps,
        names=tuple(episode.log.vector_names),
        cameras=episode.cameras,
        sizes=sizes,
        path=motion.pose(times)[:, :2],
        speeds=np.linalg.norm(motion.twist(times)[:, :3], axis=1),
        low=action.min(0),
        high=action.max(0),
        target_in_view={
            name: visible(
                CameraType(c.width, c.height, c.fovy),
                c.pose,
                episode.log.pose(episode.meta.target)[:, :3],
            )
            for name, c in infos.items()
            if c.link is None
        },
        visible=visible_shares,
        last_visible={
            camera: before_meeting(episode.log, shares) for camera, shares in visible_shares.items()
        },
        after_success=0 if success is None else int((episode.log.times > success + 1e-6).sum()),
        still=int((np.abs(np.diff(action[:-1], axis=0)).max(-1, initial=0.0) < STILL).sum()),
        instructions=(tuple(episode.instructions["seen"]), tuple(episode.instructions["unseen"])),
    )


def _visible(episode: Episode) -> dict[str, NDArray[np.float32]]:
    """Shares (T,) of the target's silhouette that are seen, by camera; tracks list the objects in
    the order of `meta`."""
    objects = [name for name in episode.meta.objects if name not in episode.meta.clutter]
    column = objects.index(episode.meta.target)
    stored = {
        camera: episode.interception.get(f"{TRACKS}{camera}/visible") for camera in episode.cameras
    }
    return {camera: shares[:, column] for camera, shares in stored.items() if shares is not None}


def by_cell(seen: Sequence[SurveyedEpisode]) -> dict[Cell, list[SurveyedEpisode]]:
    """Episodes by cell, in the order of the cells' paths."""
    cells: dict[Cell, list[SurveyedEpisode]] = defaultdict(list)
    for one in seen:
        cells[one.cell].append(one)
    return {cell: cells[cell] for cell in sorted(cells, key=lambda c: c.path)}

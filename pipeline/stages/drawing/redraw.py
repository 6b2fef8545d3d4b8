"""A stored episode drawn again from its file and its dataset's assets."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.data.cameras import Camera, CameraType, View, framed
from pipeline.data.episode.file import Episode, EpisodeError, EpisodeFile
from pipeline.data.episode.state_log import StateLog
from pipeline.data.names import OBSERVER
from pipeline.data.slots.assets import AssetError, AssetStore

from .render import Appearance, render, stored_appearance

FILMED = CameraType(640, 480, 40.0)
FACING, FREE = (-0.40, -0.70, -0.50), 0.10
"""The way a film looks, across the table at the robot, and the share of the image that stays
free."""


def redraw(path: Path, camera: str, bodies: Path) -> View:
    """One camera of a stored episode again, with depth and segmentation, by perfect sensors. Raises
    EpisodeError.
    """
    episode, appearance = read_stored(path, bodies)
    appearance = appearance.seen_by(camera)
    if not appearance.cameras:
        names = ", ".join(episode.meta.drawing.cameras)
        raise EpisodeError(f"{path}: has no camera {camera}: it has {names}")
    log = episode.log.late(episode.meta.drawing.latency)
    return render(appearance, log, depth=True, segmentation=True)[0]


def film(path: Path, bodies: Path, *cameras: str) -> list[View]:
    """A stored episode at 640x480, from a framing camera and the stored ones."""
    episode, appearance = read_stored(path, bodies)
    size = {"width": FILMED.width, "height": FILMED.height}
    stored = appearance.seen_by(*cameras).cameras
    outside = facing(episode.log, episode.meta.target, episode.meta.manipulated)
    seen = (outside, *(replace(c, type=replace(c.type, **size)) for c in stored))
    return render(replace(appearance, cameras=seen, preset="raster"), episode.log)


def facing(log: StateLog, *bodies: str) -> Camera:
    """The camera across the table that sees both arms and these bodies at every frame."""
    arms = tuple(f"{side}_" for side in log.sides)
    acting = [name for name in log.bodies if name.startswith(arms) or name in bodies]
    points = np.concatenate([log.pose(name)[:, :3] for name in acting])
    return Camera(OBSERVER, FILMED, None, framed(points, FACING, FILMED, FREE))


def read_stored(path: Path, bodies: Path) -> tuple[Episode, Appearance]:
    """A stored episode, and what it was drawn from. Raises EpisodeError."""
    with EpisodeFile(path) as file:
        episode = file.read()
    try:
        return episode, stored_appearance(episode, AssetStore(bodies))
    except AssetError as error:
        raise EpisodeError(f"{path}: cannot be drawn again: {error}") from error

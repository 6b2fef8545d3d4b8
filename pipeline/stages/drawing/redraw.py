"""A stored episode drawn again from its file and its dataset's assets."""

from pathlib import Path

from pipeline.data.cameras import View
from pipeline.data.episode.file import Episode, EpisodeError, EpisodeFile
from pipeline.data.episode.state_log import StateLog
from pipeline.data.slots.assets import AssetError, AssetStore

from .render import Appearance, render, stored_appearance


def redraw(path: Path, camera: str, bodies: Path) -> View:
    """One camera of a stored episode again, with depth and segmentation, by perfect sensors. Raises
    EpisodeError.
    """
    _, appearance, log = read_stored(path, camera, bodies)
    return render(appearance, log, depth=True, segmentation=True)[0]


def read_stored(path: Path, camera: str, bodies: Path) -> tuple[Episode, Appearance, StateLog]:
    """A stored episode, what a camera of it was drawn from, and the log as its images show it:
    late, if they are. Raises EpisodeError."""
    with EpisodeFile(path) as file:
        episode = file.read()
    try:
        appearance = stored_appearance(episode, AssetStore(bodies)).seen_by(camera)
    except AssetError as error:
        raise EpisodeError(f"{path}: cannot be drawn again: {error}") from error
    if not appearance.cameras:
        names = ", ".join(episode.meta.drawing.cameras)
        raise EpisodeError(f"{path}: has no camera {camera}: it has {names}")
    return episode, appearance, episode.log.late(episode.meta.drawing.latency)

"""A stored episode drawn again from its file and its dataset's assets."""

from pathlib import Path

from pipeline.data.cameras import View
from pipeline.data.episode.file import Episode, EpisodeError, EpisodeFile
from pipeline.data.slots.assets import AssetError, AssetStore

from .render import Appearance, render, stored_appearance


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


def read_stored(path: Path, bodies: Path) -> tuple[Episode, Appearance]:
    """A stored episode, and what it was drawn from. Raises EpisodeError."""
    with EpisodeFile(path) as file:
        episode = file.read()
    try:
        return episode, stored_appearance(episode, AssetStore(bodies))
    except AssetError as error:
        raise EpisodeError(f"{path}: cannot be drawn again: {error}") from error

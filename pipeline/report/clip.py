"""A short film of an episode: all its cameras side by side, as an H.264 mp4 that any browser
plays."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import View
from pipeline.data.episode.file import EpisodeError, EpisodeFile, open_episode
from pipeline.data.episode.mp4 import encode_mp4
from pipeline.report.film_strip import with_path

HEIGHT = 180  # pixels of each camera


def clip(path: Path, height: int = HEIGHT) -> bytes:
    """The mp4 of an episode, its cameras `height` pixels high, or as high as the highest of them if
    none reaches that.

    Raises EpisodeError for a file that is no episode or has no camera.
    """
    with open_episode(path) as e:
        if not e.cameras:
            raise EpisodeError(f"{path}: has no camera")
        highest = max(e.rgb(camera, 0).shape[0] for camera in e.cameras)
        return encode_mp4(_frames(e, min(height, 2 * round(highest / 2))), e.fps)


def observed(path: Path, draw: Callable[[Path], Sequence[View]]) -> bytes:
    """The mp4 of the first view that `draw` makes of an episode file, with the target's path.
    Raises what `draw` raises."""
    with open_episode(path) as e:
        episode, fps = e.read(), e.fps
    return encode_mp4(with_path(draw(path)[0], episode), fps, {"crf": "20"})


def _frames(e: EpisodeFile, height: int) -> Iterator[NDArray[np.uint8]]:
    """Frames (height, W, 3) of all cameras beside each other, W even."""
    for i in range(len(e)):
        row = []
        for camera in e.cameras:
            view = e.rgb(camera, i)
            width = 2 * round(view.shape[1] * height / view.shape[0] / 2)
            row.append(cv2.resize(view, (width, height), interpolation=cv2.INTER_AREA))
        yield np.ascontiguousarray(np.hstack(row), np.uint8)

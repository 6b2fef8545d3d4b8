"""A short film of an episode: all its cameras side by side, as an H.264 mp4 that any browser plays."""

import io
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode import EpisodeError, EpisodeFile, open_episode

HEIGHT = 180  # pixels of each camera
CRF, PRESET = "27", "veryfast"


def clip(path: Path, height: int = HEIGHT) -> bytes:
    """The mp4 of an episode, its cameras `height` pixels high. b"" where PyAV is not installed: it comes with the lerobot extra.

    Raises EpisodeError for a file that is no episode or has no camera.
    """
    try:
        import av
    except ImportError:
        return b""
    buffer = io.BytesIO()
    with open_episode(path) as e, av.open(buffer, "w", format="mp4") as container:
        if not e.cameras:
            raise EpisodeError(f"{path}: has no camera")
        stream = None
        for rgb in _frames(e, height):
            if stream is None:
                # one thread, so that the same episode gives the same bytes
                stream = container.add_stream("h264", e.fps, options={"crf": CRF, "preset": PRESET, "threads": "1"})
                stream.height, stream.width, stream.pix_fmt, stream.thread_count = *rgb.shape[:2], "yuv420p", 1
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        if stream is not None:
            container.mux(stream.encode())
    return buffer.getvalue()


def _frames(e: EpisodeFile, height: int) -> Iterator[NDArray[np.uint8]]:
    """Frames (height, W, 3) of all cameras beside each other, W even."""
    for i in range(len(e)):
        row = []
        for camera in e.cameras:
            view = e.rgb(camera, i)
            width = 2 * round(view.shape[1] * height / view.shape[0] / 2)
            row.append(cv2.resize(view, (width, height), interpolation=cv2.INTER_AREA))
        yield np.ascontiguousarray(np.hstack(row), np.uint8)

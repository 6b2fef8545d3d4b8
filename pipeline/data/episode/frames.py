"""Frames as standard RGB JPEG, and as a browser-playable H.264 mp4."""

import io
from collections.abc import Iterable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.errors import DominoError
from pipeline.poses import Pixels

QUALITY = 95
LARGEST = 8192  # pixels of a side of an image, as cameras allow (data/episode/meta.py)


class EpisodeError(DominoError):
    """An episode file that is missing, truncated or not of this schema."""


def encode_frames(rgb: Pixels) -> NDArray[np.bytes_]:
    """Frames (T,H,W,3) RGB as JPEG bytes (T,), padded with zeros to one length."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
    coded = [
        cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), quality)[1].tobytes()
        for frame in rgb
    ]
    return np.array(coded, dtype=f"S{max(map(len, coded))}")


def stated_size(jpeg: bytes) -> tuple[int, int]:
    """Width and height in the header of a JPEG. Raises EpisodeError if there are none, or for a
    side longer than LARGEST."""
    at = 2
    while jpeg[:2] == b"\xff\xd8" and at + 9 <= len(jpeg) and jpeg[at] == 0xFF:
        marker, length = jpeg[at + 1], int.from_bytes(jpeg[at + 2 : at + 4])
        # start of a frame, of any of the codings; the others of that range are tables
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            size = int.from_bytes(jpeg[at + 7 : at + 9]), int.from_bytes(jpeg[at + 5 : at + 7])
            if max(size) > LARGEST:
                raise EpisodeError(
                    f"a frame is {max(size)} pixels wide or high; {LARGEST} are allowed"
                )
            return size
        at += 2 + length
    raise EpisodeError("a frame does not decode as JPEG")


def decode_frame(jpeg: bytes) -> Pixels:
    """JPEG bytes as (H,W,3) RGB. Raises EpisodeError."""
    stated_size(jpeg)
    bgr = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise EpisodeError("a frame does not decode as JPEG")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


OPTIONS = {"crf": "27", "preset": "veryfast", "threads": "1", "x264-params": "aq-mode=0:mbtree=0"}
"""With more threads or look-ahead the same frames give other bytes now and then."""


def encode_mp4(frames: Iterable[Pixels], fps: int, more: Mapping[str, str] | None = None) -> bytes:
    """Frames (H,W,3) RGB, H and W even, as mp4; b"" without frames."""
    import av  # a tenth of a second

    buffer, stream = io.BytesIO(), None
    with av.open(buffer, "w", format="mp4") as container:
        for rgb in frames:
            if stream is None:
                stream = container.add_stream("h264", fps, options=OPTIONS | dict(more or {}))
                stream.height, stream.width = rgb.shape[:2]
                stream.pix_fmt, stream.thread_count = "yuv420p", 1
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        if stream is not None:
            container.mux(stream.encode())
    return buffer.getvalue() if stream is not None else b""

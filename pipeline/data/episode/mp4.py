"""Frames as a browser-playable H.264 mp4."""

import io
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

OPTIONS = {"crf": "27", "preset": "veryfast", "threads": "1", "x264-params": "aq-mode=0:mbtree=0"}
"""With more threads or look-ahead the same frames give other bytes now and then."""


def encode_mp4(
    frames: Iterable[NDArray[np.uint8]], fps: int, more: Mapping[str, str] | None = None
) -> bytes:
    """Frames (H,W,3) RGB, H and W even, as mp4; b"" without frames."""
    import av  # a tenth of a second

    buffer, stream = io.BytesIO(), None
    with av.open(buffer, "w", format="mp4") as container:
        for rgb in frames:
            if stream is None:
                stream = container.add_stream("h264", fps, options=OPTIONS | dict(more or {}))
                stream.height, stream.width, stream.pix_fmt, stream.thread_count = (
                    *rgb.shape[:2],
                    "yuv420p",
                    1,
                )
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        if stream is not None:
            container.mux(stream.encode())
    return buffer.getvalue() if stream is not None else b""

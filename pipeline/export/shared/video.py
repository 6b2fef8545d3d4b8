"""Encodes and decodes the images of an episode."""

import io
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.error import FFmpegError

from pipeline.data.episode.frames import EpisodeError
from pipeline.poses import Pixels

from .episodes import ExportError


@dataclass(frozen=True)
class EncoderLimits:
    """Beyond `largest_crf` it clips silently. `alone` makes bytes a function of the frames,
    `predicted` of predicted ones: x264's look-ahead differs now and then."""

    crf: int
    largest_crf: int
    preset: str
    alone: dict[str, str]
    predicted: dict[str, str]


ONE_THREAD = {"threads": "1"}
X265 = {"x265-params": "pools=none:frame-threads=1:log-level=error"}
SVT = {"svtav1-params": "fast-decode=0:lp=1:enable-tf=0"}
H264_PREDICTED = {"bf": "0", "x264-params": "aq-mode=0:mbtree=0"}
ENCODERS = {
    "h264": EncoderLimits(20, 51, "ultrafast", ONE_THREAD, H264_PREDICTED),
    "libsvtav1": EncoderLimits(32, 63, "12", SVT, {}),
    "hevc": EncoderLimits(25, 51, "ultrafast", ONE_THREAD | X265, {"bf": "0"}),
}
CODECS = tuple(ENCODERS)


@dataclass(frozen=True)
class Codec:
    """Encoder settings; None is what ENCODERS has. Reasons: docs/measurements/export.md."""

    name: str = "h264"
    crf: int | None = None
    gop: int = 1
    preset: str | None = None
    pix_fmt: str = "yuv420p"

    @property
    def quality(self) -> int:
        return ENCODERS[self.name].crf if self.crf is None else self.crf

    def options(self) -> dict[str, str]:
        """Options for libav; one thread, so that the same frames give the same bytes."""
        encoder = ENCODERS[self.name]
        return {
            "g": str(self.gop),
            "crf": str(self.quality),
            "preset": self.preset or encoder.preset,
            **encoder.alone,
            **(encoder.predicted if self.gop > 1 else {}),
        }

    def check(self) -> None:
        if self.name not in CODECS or self.name not in av.codecs_available:
            known = ", ".join(CODECS)
            raise ExportError(f"video codec {self.name!r} is not available: use {known}")
        largest = ENCODERS[self.name].largest_crf
        if not 0 <= self.quality <= largest:
            raise ExportError(f"--crf {self.quality}: {self.name} takes 0 to {largest}")


def decoded_planes(jpegs: Iterable[bytes]) -> Iterator[Any]:
    """The JPEG's own planes: RGB and back costs as much as encoding. Raises EpisodeError."""
    decoder: Any = av.CodecContext.create("mjpeg", "r")
    decoder.thread_count, decoder.options = 1, {"err_detect": "explode"}
    for jpeg in jpegs:
        try:
            (frame,) = list(decoder.decode(av.Packet(jpeg)) if jpeg else ())
        except (FFmpegError, ValueError) as error:
            raise EpisodeError("a frame does not decode as JPEG") from error
        frame.pts = None
        yield frame


def samples(plane: Any) -> Pixels:
    """A view (H,W): it shares the memory."""
    return np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width]


def encode(frames: Iterable[Any], fps: int, codec: Codec) -> bytes:
    """RGB (H,W,3) uint8 or planes, H and W even -> an mp4. Raises ExportError."""
    os.environ.setdefault("SVT_LOG", "1")  # errors only
    buffer = io.BytesIO()
    try:
        with av.open(buffer, "w", format="mp4") as container:
            stream: Any = None
            for given in frames:
                if isinstance(given, av.VideoFrame):
                    frame = given.reformat(format=codec.pix_fmt, src_color_range="JPEG")
                else:
                    frame = av.VideoFrame.from_ndarray(given, format="rgb24")
                if stream is None:
                    stream = container.add_stream(codec.name, fps, options=codec.options())
                    stream.height, stream.width = frame.height, frame.width
                    stream.pix_fmt, stream.thread_count = codec.pix_fmt, 1
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
    except FFmpegError as error:
        given = f"{codec.name} cannot encode with {codec.options()} ({error})"
        raise ExportError(f"{given}: choose another --preset") from error
    return buffer.getvalue()


def frames_of(path: Path | io.BytesIO) -> Iterator[tuple[float, Pixels]]:
    """Yield (time s, RGB image) of every frame of a video, in order."""
    with av.open(path if isinstance(path, io.BytesIO) else str(path), "r") as container:
        container.streams.video[0].thread_count = 1
        for frame in container.decode(video=0):
            assert frame.time is not None
            yield frame.time, np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)

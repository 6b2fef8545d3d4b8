"""Video files of a LeRobot dataset: each episode is encoded alone and appended without encoding."""

import io
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

OPTIONS = {"movflags": "faststart", "write_btrt": "0"}
"""The index comes first, so that a part can be played from a server. The box of bit rates would say
how the clips were made."""


@dataclass
class VideoFile:
    """An mp4 of `frames` images and about `size` bytes that grows by episodes."""

    path: Path
    fps: int
    frames: int = 0
    size: int = 0
    _output: Any = field(default=None, repr=False)
    _stream: Any = field(default=None, repr=False)

    def append(self, mp4: bytes, frames: int) -> tuple[float, float]:
        """Add an episode; returns its start and end (s). Raises ValueError for another number of
        images."""
        begin = self.frames
        with av.open(io.BytesIO(mp4), "r") as clip:
            template: Any = clip.streams.video[0]
            if self._output is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._output = av.open(str(self.path), "w", format="mp4", options=OPTIONS)
                self._stream = self._output.add_stream_from_template(template, opaque=True)
                self._stream.time_base = template.time_base
            packets: list[Any] = [p for p in clip.demux(video=0) if p.dts is not None]
            if len(packets) != frames:
                raise ValueError(f"the encoder returned {len(packets)} images for {frames} frames")
            shift = int(begin / (self.fps * Fraction(template.time_base or 1)))
            for packet in packets:
                packet.pts, packet.dts = packet.pts + shift, packet.dts + shift
                packet.stream = self._stream
                self._output.mux(packet)
        self.frames, self.size = begin + frames, self.size + len(mp4)
        return begin / self.fps, self.frames / self.fps

    def close(self) -> None:
        output, self._output = self._output, None
        if output is not None:
            # an open one would be finished, and its errors printed, when it is collected
            output.close()

"""Video files of a LeRobot dataset: each episode is encoded alone and appended without encoding.
meta/domino_encoded.parquet has what a later export needs to take videos over."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.tables import RowWriter

OPTIONS = {"movflags": "faststart", "write_btrt": "0"}
"""The index comes first, so that a part can be played from a server. The box of bit rates would say
how the clips were made."""

ENCODED = "meta/domino_encoded.parquet"
SCHEMA = pa.schema(
    {
        **dict.fromkeys(("sha256", "camera", "file"), pa.string()),
        **dict.fromkeys(("start", "bytes", "sampled"), pa.int64()),
        "colors": pa.list_(pa.int64()),
    }
)
ROWS_PER_GROUP = 300


@dataclass(frozen=True)
class Clip:
    """An episode of a camera: its mp4 of `size` bytes, or its place in an older `file`."""

    name: str
    size: int
    mp4: bytes = b""
    file: Path | None = None
    start: int = 0


class _Source:
    """Packets of clips, read on from where the last one ended."""

    def __init__(self) -> None:
        self._container: Any = None
        self._file: Path | None = None
        self._packets: Iterator[Any] = iter(())
        self._next = 0

    def open(self, clip: Clip) -> Any:
        """The stream that holds a clip, at its first packet."""
        if clip.file is None or clip.file != self._file or clip.start != self._next:
            self.close()
            self._container = av.open(io.BytesIO(clip.mp4) if clip.file is None else str(clip.file))
            self._file = clip.file
            self._packets = (p for p in self._container.demux(video=0) if p.dts is not None)
            self._next = len(self._take(clip.start))
        return self._container.streams.video[0]

    def _take(self, count: int) -> list[Any]:
        return [p for _, p in zip(range(count), self._packets, strict=False)]

    def take(self, count: int) -> list[Any]:
        """The next packets, at most `count`, and one more from memory, where there must be none."""
        packets = self._take(count + (self._file is None))
        self._next += len(packets)
        return packets

    def close(self) -> None:
        if self._container is not None:
            self._container.close()
            self._container, self._file = None, None


@dataclass
class VideoFile:
    """An mp4 that grows by episodes. Older clips wait for a new one: a file of older ones is
    taken over."""

    path: Path
    fps: int
    draft: ExportDraft | None = None
    frames: int = 0
    size: int = 0
    _names: list[str] = field(default_factory=list, repr=False)
    _waiting: list[tuple[Clip, int]] = field(default_factory=list, repr=False)
    _source: _Source = field(default_factory=_Source, repr=False)
    _written: int = 0
    _output: Any = field(default=None, repr=False)
    _stream: Any = field(default=None, repr=False)

    def append(self, clip: Clip, frames: int) -> tuple[float, float]:
        """Its start and end (s). Raises ValueError for another number of images."""
        begin = self.frames / self.fps
        self._names.append(clip.name)
        self._waiting.append((clip, frames))
        self.size += clip.size
        self.frames += frames
        if self._output is not None or clip.file is None:
            self._write()
        return begin, self.frames / self.fps

    def _write(self) -> None:
        waiting, self._waiting = self._waiting, []
        for clip, frames in waiting:
            template = self._source.open(clip)
            if self._output is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._output = av.open(str(self.path), "w", format="mp4", options=OPTIONS)
                self._stream = self._output.add_stream_from_template(template, opaque=True)
                self._stream.time_base = template.time_base
            packets = self._source.take(frames)
            if len(packets) != frames:
                raise ValueError(f"the encoder returned {len(packets)} images for {frames} frames")
            tick = self.fps * Fraction(template.time_base or 1)
            shift = int((self._written - clip.start) / tick)
            for packet in packets:
                packet.pts, packet.dts = packet.pts + shift, packet.dts + shift
                packet.stream = self._stream
                self._output.mux(packet)
            self._written += frames

    def close(self) -> None:
        made_from, draft = ["video", self.fps, *self._names], self.draft
        if self._output is None and draft is not None and draft.keep(self.path, made_from):
            self._waiting.clear()
        try:
            self._write()
        finally:
            self._source.close()
            if (output := self._output) is not None:
                self._output = self._stream = None
                # an open one would be finished, and its errors printed, when it is collected
                output.close()
        if output is not None and draft is not None:
            draft.record(self.path, made_from)


@dataclass(frozen=True, eq=False)
class Encoded:
    """A clip and color counts (3,256) over `sampled` images, by camera."""

    videos: dict[str, Clip]
    colors: dict[str, NDArray[np.int64]]
    sampled: int


def clip_name(sha: str, camera: str) -> str:
    return f"{sha}/{camera}"


class EncodedFile(RowWriter):
    """ENCODED of the dataset at `root`."""

    def __init__(self, draft: ExportDraft, root: Path) -> None:
        self.draft, self.path = draft, root / ENCODED
        super().__init__(self.path, SCHEMA, ROWS_PER_GROUP)

    def _name(self, file: Path) -> str:
        return file.relative_to(self.draft.folder).as_posix()

    def append(self, sha: str, encoded: Encoded, places: dict[str, tuple[Path, int]]) -> None:
        """Add an episode; `places` has the video file and its first image by camera."""
        rows: list[dict[str, Any]] = []
        for camera, clip in encoded.videos.items():
            file, start = places[camera]
            row = {"sha256": sha, "camera": camera, "file": self._name(file), "start": start}
            row |= {"bytes": clip.size, "sampled": encoded.sampled}
            rows.append(row | {"colors": encoded.colors[camera].ravel()})
        self.add(*rows)

    def close(self) -> None:
        if self.is_open:
            super().close()
            self.draft.record(self.path, ["encoded", self._name(self.path)])


class OlderVideos:
    """Lent by an older export, by the sha256 of their episode."""

    def __init__(self, draft: ExportDraft) -> None:
        self.older = draft.older
        self._at: dict[str, tuple[Path, int]] = {}
        self._read: tuple[tuple[Path, int], list[dict[str, Any]]] | None = None
        for name in sorted(name for name in self.older.record.contents if name.endswith(ENCODED)):
            if path := self.older.sound(name):
                file = pq.ParquetFile(path)
                for group in range(file.num_row_groups):
                    hashes = file.read_row_group(group, columns=["sha256"])["sha256"].to_pylist()
                    self._at |= dict.fromkeys(hashes, (path, group))

    def find(self, sha: str) -> Encoded | None:
        """None if one of them is missing or changed."""
        place = self._at.get(sha)
        if place is None:
            return None
        if self._read is None or self._read[0] != place:
            self._read = place, pq.ParquetFile(place[0]).read_row_group(place[1]).to_pylist()
        rows: Sequence[dict[str, Any]] = [row for row in self._read[1] if row["sha256"] == sha]
        videos, colors = {}, {}
        for row in rows:
            file, camera = self.older.sound(row["file"]), row["camera"]
            if file is None:
                return None
            name = clip_name(sha, camera)
            videos[camera] = Clip(name, row["bytes"], file=file, start=row["start"])
            colors[camera] = np.array(row["colors"], np.int64).reshape(3, -1)
        return Encoded(videos, colors, rows[0]["sampled"])

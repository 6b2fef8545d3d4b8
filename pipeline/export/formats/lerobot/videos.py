"""Video files of a LeRobot dataset: each episode is encoded alone and appended without encoding."""

import io
import os
from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any

import av
import cv2

from pipeline.export.shared.episodes import ExportError, Facts, read_facts, reading
from pipeline.export.shared.images import DEPTH, coded_images
from pipeline.export.shared.statistics import PlaneCounts, sample_rows
from pipeline.export.shared.video import decoded_planes, encode
from pipeline.poses import Ints

from .options import LerobotOptions

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
        """Returns start and end (s). Raises ExportError for another number of images."""
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
                counts = f"the encoder returned {len(packets)} images for {frames} frames"
                raise ExportError(f"{self.path.name}: {counts}")
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


@dataclass(frozen=True, eq=False)
class Prepared:
    """An episode to append: by camera its mp4, color counts (3,256) over `sampled` images, depth
    PNGs."""

    facts: Facts
    videos: Mapping[str, bytes]
    colors: Mapping[str, Ints]
    sampled: int
    depth: Mapping[str, Sequence[bytes]]


def prepare(path: Path, dataset: Path, options: LerobotOptions) -> Prepared:
    """Read and encode an episode. Raises ExportError, also for odd sizes (4:2:0)."""
    with reading(path) as file:
        facts = read_facts(file, dataset, options.after_success, options.representation)
        facts = replace(facts, more=options.more_representations, labels=options.labels)
        if facts.size[0] % 2 or facts.size[1] % 2:
            raise ExportError(f"{path}: height and width of images must be even, not {facts.size}")
        maps, videos, colors = {}, dict[str, bytes](), dict[str, Ints]()
        if getattr(options, "depth", False):
            maps = {c: coded_images(file, c, DEPTH)[: facts.kept] for c in file.cameras}
        rows = frozenset(sample_rows(facts.kept).tolist())
        for camera in facts.cameras:
            counted = PlaneCounts()
            jpegs = file.array(f"observation/{camera}/rgb").tolist()[: facts.kept]
            frames = counted.passing(decoded_planes(jpegs), rows)
            videos[camera] = encode(frames, facts.fps, options.video())
            colors[camera] = counted.counts()
    return Prepared(facts, videos, colors, len(sample_rows(facts.kept)), maps)


def prepare_all(
    paths: Sequence[Path], dataset: Path, options: LerobotOptions, workers: int
) -> Iterator[Prepared]:
    if workers <= 1:
        with _one_thread():
            yield from (prepare(path, dataset, options) for path in paths)
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), start_worker) as pool:
        pending: deque[Future[Prepared]] = deque()
        try:
            for path in paths:
                pending.append(pool.submit(prepare, path, dataset, options))
                if len(pending) > 2 * workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        except BrokenProcessPool as error:
            died = "an encoding process died, perhaps for want of memory; try fewer workers"
            raise ExportError(died) from error
        finally:
            for future in pending:
                future.cancel()


def start_worker() -> None:
    """One thread of OpenCV, and an end with the parent."""
    cv2.setNumThreads(1)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _one_thread() -> Generator[None]:
    """Other threads would wait busily between short calls."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)

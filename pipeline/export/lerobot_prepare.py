"""Reads and encodes the episodes of a LeRobot export, in this process or in several; the output does not depend on how many.

lerobot itself is not imported here: that costs every process some ten seconds.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.export.common import ExportError, Facts, read_facts, reading
from pipeline.export.stats import plane_counts, sample_rows
from pipeline.export.video import Codec, decoded_planes, encode


@dataclass(frozen=True, eq=False)
class Prepared:
    """An episode ready to be appended: facts, mp4 bytes by camera, colour counts (3,256) by camera over `sampled` images."""

    facts: Facts
    videos: dict[str, bytes]
    colors: dict[str, NDArray[np.int64]]
    sampled: int


def prepare(path: Path, dataset: Path, codec: Codec) -> Prepared:
    """Read and encode one episode. Raises ExportError for a bad file or a image size that 4:2:0 video cannot hold."""
    with reading(path) as file:
        facts = read_facts(file, dataset)
        if facts.size[0] % 2 or facts.size[1] % 2:
            raise ExportError(f"{path}: images of {facts.size} cannot become video; height and width must be even")
        rows = sample_rows(len(facts))
        videos, colors = {}, {}
        for camera in facts.cameras:
            frames = list(decoded_planes(file.array(f"observation/{camera}/rgb").tolist()))
            colors[camera] = plane_counts([frames[i] for i in rows])
            videos[camera] = encode(frames, facts.fps, codec)
    return Prepared(facts, videos, colors, len(rows))


def prepare_all(paths: Sequence[Path], dataset: Path, codec: Codec, workers: int) -> Iterator[Prepared]:
    """`prepare` for all paths in order, in `workers` processes, at most two episodes a worker ahead of the reader."""
    if workers <= 1:
        yield from (prepare(p, dataset, codec) for p in paths)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        pending: deque[Future[Prepared]] = deque()
        try:
            for path in paths:
                pending.append(pool.submit(prepare, path, dataset, codec))
                if len(pending) > 2 * workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        except BrokenProcessPool as error:
            raise ExportError("an encoding process died, perhaps for want of memory; try fewer workers") from error
        finally:
            for future in pending:
                future.cancel()

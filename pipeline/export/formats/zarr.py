"""Replay buffers in zarr, as Diffusion Policy and DP3 read them: the episodes of a robot one after
another (docs/exports.md). Nothing is shifted."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import HEAD
from pipeline.export.exporter import Exporter, Job, register
from pipeline.export.formats.zarr_files import ZarrArray, begin_group
from pipeline.export.options import ActionOptions, camera_names, image_size, one_of, option, whole
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import (
    ExportError,
    Facts,
    by_embodiment,
    exported_cameras,
    read_facts,
    reading,
)
from pipeline.export.shared.images import resize
from pipeline.export.shared.provenance import PROVENANCE, Provenance

BUFFER = "replay_buffer.zarr"


@dataclass(frozen=True)
class ZarrOptions(ActionOptions):
    """Options of the format; `size` is (height, width) in pixels."""

    size: tuple[int, int] | None = option(
        "WIDTHxHEIGHT in pixels to resize images to, like 84x84", image_size, None
    )
    channels: Literal["first", "last"] = option(
        "last: (N,H,W,3); first: (N,3,H,W), RoboTwin's DP", one_of("first", "last"), "last"
    )
    chunk_frames: int = option("frames of a chunk", whole(1), 100)
    camera_names: Mapping[str, str] = option(
        "names of cameras; default head=img, the others as stored", camera_names, factory=dict
    )


@dataclass(frozen=True)
class ArraySpan:
    """Rows of an episode that lie in a chunk."""

    path: Path
    sha: str
    start: int
    stop: int


@dataclass
class Buffer:
    """The episodes of a robot as N rows; the last episode read stays in memory."""

    dataset: Path
    paths: Sequence[Path]
    options: ZarrOptions
    last: tuple[Path, dict[str, NDArray[Any]]] | None = field(default=None)

    def __post_init__(self) -> None:
        lengths = []
        for path in self.paths:
            with reading(path) as file:
                lengths.append(len(file))
        self.ends = np.cumsum(lengths)
        self.kinds = {
            key: (value.dtype, value.shape[1:]) for key, value in self.values(self.paths[0]).items()
        }

    def arrays(self, root: Path) -> dict[str, ZarrArray]:
        """Arrays on disk by key."""
        count, rows = int(self.ends[-1]), self.options.chunk_frames
        return {
            key: ZarrArray(root / "data" / key, (count, *shape), dtype, rows)
            for key, (dtype, shape) in self.kinds.items()
        }

    def spans(self, chunk: int, hashes: Mapping[Path, str]) -> list[ArraySpan]:
        """The parts of episodes that make a chunk."""
        low, high = (
            chunk * self.options.chunk_frames,
            min((chunk + 1) * self.options.chunk_frames, int(self.ends[-1])),
        )
        spans = []
        first, last = np.searchsorted(self.ends, (low, high - 1), side="right").tolist()
        for number in range(first, last + 1):
            path, start = self.paths[number], int(self.ends[number - 1]) if number else 0
            spans.append(
                ArraySpan(
                    path,
                    hashes.get(path, ""),
                    max(low - start, 0),
                    min(high, int(self.ends[number])) - start,
                )
            )
        return spans

    def chunk(self, key: str, spans: Sequence[ArraySpan]) -> NDArray[Any]:
        """The rows of a chunk of an array."""
        return np.concatenate(
            [self.values(span.path)[key][span.start : span.stop] for span in spans]
        )

    def values(self, path: Path) -> dict[str, NDArray[Any]]:
        """As `episode_values`. Raises ExportError if the first episode has other arrays."""
        if self.last is None or self.last[0] != path:
            with reading(path) as file:
                values = episode_values(
                    file,
                    read_facts(file, self.dataset, representation=self.options.representation),
                    self.options,
                )
            kinds = {key: (value.dtype, value.shape[1:]) for key, value in values.items()}
            if self.last is not None and kinds != self.kinds:
                odd = sorted(
                    key for key in {*kinds, *self.kinds} if kinds.get(key) != self.kinds.get(key)
                )
                raise ExportError(
                    f"{path}: {odd[0]} is not as in {self.paths[0]}; export them separately with"
                    " --where"
                )
            self.last = path, values
        return self.last[1]


def episode_values(
    file: EpisodeFile, facts: Facts, options: ZarrOptions
) -> dict[str, NDArray[Any]]:
    """Arrays of an episode by key, frames first. Raises ExportError."""
    values: dict[str, NDArray[Any]] = {
        "state": facts.log.state.astype(np.float32),
        "action": facts.action.astype(np.float32),
    }
    for camera, name in cameras_of(facts, options).items():
        images = np.stack([resize(image, options.size) for image in file.frames(camera)])
        values[name] = np.moveaxis(images, -1, 1) if options.channels == "first" else images
        if file.has(f"observation/{camera}/depth"):
            values[f"depth_{name}"] = file.array(f"observation/{camera}/depth")
    if file.has("pointcloud"):
        values["point_cloud"] = file.array("pointcloud").astype(np.float32)
    return values


def cameras_of(facts: Facts, options: ZarrOptions) -> dict[str, str]:
    """Array of each camera. Raises ExportError."""
    usual = {camera: "img" if camera == HEAD else camera for camera in facts.cameras}
    return exported_cameras(facts, {**usual, **options.camera_names})


@register
class Zarr(Exporter[ZarrOptions]):
    """One replay buffer a robot."""

    name = "zarr"
    options = ZarrOptions

    def sensors(self, options: ZarrOptions) -> Collection[str]:
        return ("depth", "pointcloud")

    def write(self, job: Job[ZarrOptions], draft: ExportDraft) -> dict[str, Any]:
        frames, cameras = 0, dict[str, str]()
        for directory, paths in by_embodiment(job.episodes, draft.folder).values():
            buffer = Buffer(job.dataset, paths, job.options)
            cameras |= _describe(buffer, directory, job, draft)
            _write(buffer, directory / BUFFER, draft)
            frames += int(buffer.ends[-1])
        return {"episodes": len(job.episodes), "frames": frames, "cameras": cameras}


def ends_of(buffer: Buffer, root: Path) -> ZarrArray:
    return ZarrArray(
        root / "meta" / "episode_ends", (len(buffer.ends),), np.dtype("<i8"), len(buffer.ends)
    )


def _describe(
    buffer: Buffer, directory: Path, job: Job[ZarrOptions], draft: ExportDraft
) -> dict[str, str]:
    """Write episodes.parquet and return the names of the cameras."""
    names = dict[str, str]()
    with closing(Provenance(directory / PROVENANCE, draft)) as rows:
        for path in buffer.paths:
            with reading(path) as file:
                facts = read_facts(file, job.dataset)
            names = cameras_of(facts, job.options)
            rows.append(facts)
            job.advance()
    return names


def _write(buffer: Buffer, root: Path, draft: ExportDraft) -> None:
    hashes = {path: draft.hash_of(path) for path in buffer.paths}
    arrays, ends = buffer.arrays(root), ends_of(buffer, root)
    for folder in (root, root / "data", root / "meta"):
        begin_group(folder)
    for array in (*arrays.values(), ends):
        array.begin()
    ends.write(0, buffer.ends)
    for number in range(arrays["state"].chunks):
        spans = buffer.spans(number, hashes)
        for key, array in arrays.items():
            made_from = [
                key,
                array.shape[1:],
                [[span.sha, span.start, span.stop] for span in spans],
            ]
            if not draft.keep(array.chunk(number), made_from):
                array.write(number, buffer.chunk(key, spans))
                draft.record(array.chunk(number), made_from)

"""Replay buffers in zarr for Diffusion Policy and DP3 (docs/exports.md), in format 2. They are
written by hand so that chunks of an older export are linked."""

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import HEAD
from pipeline.export.exporter import Exporter, Job, register
from pipeline.export.options import (
    ImageOptions,
    camera_names_option,
    one_of,
    option,
    whole,
)
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import (
    ExportError,
    Facts,
    by_embodiment,
    exported_cameras,
    read_facts,
    reading,
)
from pipeline.export.shared.images import DEPTH, POINTCLOUD, resize
from pipeline.export.shared.tables import PROVENANCE, Provenance

BUFFER = "replay_buffer.zarr"
LEVEL = 3


@dataclass(frozen=True)
class ZarrOptions(ImageOptions):
    channels: Literal["first", "last"] = option(
        "last: (N,H,W,3); first: (N,3,H,W), RoboTwin's DP", one_of("first", "last"), "last"
    )
    chunk_frames: int = option("frames of a chunk", whole(1), 100)
    camera_names: Mapping[str, str] = camera_names_option(
        "names of cameras; default head=img, the others as stored"
    )


@dataclass(frozen=True)
class ZarrArray:
    """An array on disk with `rows` of the first axis in every chunk."""

    folder: Path
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    rows: int

    def begin(self) -> None:
        values = {
            "chunks": [self.rows, *self.shape[1:]],
            "compressor": {"id": "zstd", "level": LEVEL},
            "dtype": self.dtype.str,
            "fill_value": 0,
            "filters": None,
            "order": "C",
            "shape": self.shape,
            "zarr_format": 2,
        }
        self.folder.mkdir(parents=True)
        text = json.dumps(values, indent=4, sort_keys=True)
        (self.folder / ".zarray").write_text(text)

    def chunk(self, number: int) -> Path:
        return self.folder / ".".join([str(number), *("0" for _ in self.shape[1:])])

    def write(self, number: int, values: NDArray[Any]) -> None:
        """Write a chunk; the last one is filled up with zeros."""
        filled = np.zeros((self.rows, *self.shape[1:]), self.dtype)
        filled[: len(values)] = values
        coded = pa.Codec("zstd", LEVEL).compress(filled.tobytes(), asbytes=True)
        self.chunk(number).write_bytes(coded)


class Buffer:
    """The episodes of a robot, which end at rows `ends`."""

    def __init__(self, job: Job[ZarrOptions], paths: Sequence[Path]) -> None:
        self.job, self.options, self.paths = job, job.options, paths
        self._last: tuple[Path, dict[str, NDArray[Any]]] | None = None
        lengths = []
        for path in paths:
            with reading(path) as file:
                lengths.append(len(file))
        self.ends = np.cumsum(lengths)
        self.kinds = _kinds(self.values(paths[0]))

    def values(self, path: Path) -> dict[str, NDArray[Any]]:
        """As `episode_values`. Raises ExportError if the first episode has other arrays."""
        if self._last is None or self._last[0] != path:
            with reading(path) as file:
                representation = self.options.representation
                facts = read_facts(file, self.job.dataset, representation=representation)
                values = episode_values(file, facts, self.options)
            kinds = _kinds(values)
            if self._last is not None and kinds != self.kinds:
                odd = min(k for k in {*kinds, *self.kinds} if kinds.get(k) != self.kinds.get(k))
                differs = f"{odd} is not as in {self.paths[0]}; export them separately with --where"
                raise ExportError(f"{path}: {differs}")
            self._last = path, values
        return self._last[1]

    def describe(self, directory: Path, draft: ExportDraft) -> dict[str, str]:
        """Write episodes.parquet; returns camera names."""
        names = dict[str, str]()
        with closing(Provenance(directory / PROVENANCE, draft)) as rows:
            for path in self.paths:
                with reading(path) as file:
                    facts = read_facts(file, self.job.dataset)
                names = cameras_of(facts, self.options)
                rows.append(facts)
                self.job.advance()
        return names

    def write(self, root: Path, draft: ExportDraft) -> None:
        """Write the groups and arrays, or take chunks over."""
        count, rows = int(self.ends[-1]), self.options.chunk_frames
        arrays = {
            key: ZarrArray(root / "data" / key, (count, *shape), dtype, rows)
            for key, (dtype, shape) in self.kinds.items()
        }
        episodes, place = len(self.ends), root / "meta" / "episode_ends"
        ends = ZarrArray(place, (episodes,), np.dtype("<i8"), episodes)
        for folder in (root, root / "data", root / "meta"):
            folder.mkdir(parents=True)
            (folder / ".zgroup").write_text(json.dumps({"zarr_format": 2}, indent=4))
        for array in (*arrays.values(), ends):
            array.begin()
        ends.write(0, self.ends)
        starts = [0, *self.ends.tolist()]
        for number, low in enumerate(range(0, count, rows)):
            high, spans = min(low + rows, count), list[tuple[Path, int, int]]()
            first, last = np.searchsorted(self.ends, (low, high - 1), side="right").tolist()
            for k in range(first, last + 1):
                begin, end = max(low, starts[k]), min(high, starts[k + 1])
                spans.append((self.paths[k], begin - starts[k], end - starts[k]))
            hashes = [[draft.hash_of(path), begin, end] for path, begin, end in spans]
            for key, array in arrays.items():
                made, made_from = array.chunk(number), [key, array.shape[1:], hashes]
                if not draft.keep(made, made_from):
                    parts = [self.values(path)[key][begin:end] for path, begin, end in spans]
                    array.write(number, np.concatenate(parts))
                    draft.record(made, made_from)


def _kinds(values: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    return {key: (value.dtype, value.shape[1:]) for key, value in values.items()}


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
    if file.has(POINTCLOUD):
        values["point_cloud"] = file.array(POINTCLOUD).astype(np.float32)
    return values


def cameras_of(facts: Facts, options: ZarrOptions) -> dict[str, str]:
    usual = {camera: "img" if camera == HEAD else camera for camera in facts.cameras}
    return exported_cameras(facts, {**usual, **options.camera_names})


@register
class Zarr(Exporter[ZarrOptions]):
    name = "zarr"
    options = ZarrOptions
    written = (DEPTH, POINTCLOUD)

    def write(self, job: Job[ZarrOptions], draft: ExportDraft) -> dict[str, Any]:
        frames, cameras = 0, dict[str, str]()
        for directory, paths in by_embodiment(job.episodes, draft.folder).values():
            buffer = Buffer(job, paths)
            cameras |= buffer.describe(directory, draft)
            buffer.write(directory / BUFFER, draft)
            frames += int(buffer.ends[-1])
        return {"episodes": len(job.episodes), "frames": frames, "cameras": cameras}

"""Replay buffers in zarr for Diffusion Policy and DP3 (docs/exports.md), in format 2."""

import json
from collections.abc import Mapping
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
from pipeline.export.options import ImageOptions, camera_names_option, one_of, option, whole
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import ExportError, Facts, by_embodiment, exported_cameras
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


class ZarrArray:
    """An array (N,...) that grows on disk, with `rows` of its first axis in every chunk."""

    def __init__(self, folder: Path, rows: int) -> None:
        self.folder, self.rows = folder, rows
        self._waiting, self._count = list[NDArray[Any]](), 0
        folder.mkdir(parents=True)

    def append(self, values: NDArray[Any]) -> None:
        self._waiting.append(values)
        while sum(map(len, self._waiting)) >= self.rows:
            joined = np.concatenate(self._waiting)
            self._write(joined[: self.rows])
            self._waiting = [joined[self.rows :]]

    def close(self) -> None:
        """Write the last chunk, filled up with zeros, and what describes the array."""
        last = np.concatenate(self._waiting)
        if count := len(last):
            self._write(np.pad(last, [(0, self.rows - count)] + [(0, 0)] * (last.ndim - 1)))
            self._count += count - self.rows
        values = {
            "chunks": [self.rows, *last.shape[1:]],
            "compressor": {"id": "zstd", "level": LEVEL},
            "dtype": last.dtype.str,
            "fill_value": 0,
            "filters": None,
            "order": "C",
            "shape": [self._count, *last.shape[1:]],
            "zarr_format": 2,
        }
        text = json.dumps(values, indent=4, sort_keys=True)
        (self.folder / ".zarray").write_text(text)

    def _write(self, values: NDArray[Any]) -> None:
        name = ".".join([str(self._count // self.rows), *("0" for _ in values.shape[1:])])
        coded = pa.Codec("zstd", LEVEL).compress(values.tobytes(), asbytes=True)
        (self.folder / name).write_bytes(coded)
        self._count += self.rows


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
        counts, cameras = {"episodes": len(job.episodes), "frames": 0}, dict[str, str]()
        for directory, paths in by_embodiment(job.episodes, draft.folder).values():
            root, kinds = directory / BUFFER, dict[str, Any]()
            arrays, ends = dict[str, ZarrArray](), [0]
            with closing(Provenance(directory / PROVENANCE, draft)) as rows:
                for path in paths:
                    with rows.noting(job, path) as (file, facts):
                        values = episode_values(file, facts, job.options)
                    found = {key: (each.dtype, each.shape[1:]) for key, each in values.items()}
                    if found != (kinds := kinds or found):
                        odd = min(k for k in {*found, *kinds} if found.get(k) != kinds.get(k))
                        differs = f"{odd} is not as in {paths[0]}; export them separately"
                        raise ExportError(f"{path}: {differs} with --where")
                    for key, each in values.items():
                        if key not in arrays:
                            arrays[key] = ZarrArray(root / "data" / key, job.options.chunk_frames)
                        arrays[key].append(each)
                    ends.append(ends[-1] + len(facts))
                    cameras |= cameras_of(facts, job.options)
            arrays["ends"] = ZarrArray(root / "meta" / "episode_ends", len(paths))
            arrays["ends"].append(np.array(ends[1:], "<i8"))
            for array in arrays.values():
                array.close()
            for folder in (root, root / "data", root / "meta"):
                (folder / ".zgroup").write_text(json.dumps({"zarr_format": 2}, indent=4))
            counts["frames"] += ends[-1]
        return counts | {"cameras": cameras}

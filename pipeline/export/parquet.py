"""Flat Parquet: one row a frame, images as the JPEG bytes of the episode file, one row group an episode.

    data-00000.parquet ...   about FILE_BYTES each
    episodes.parquet         one row an episode: `provenance.PROVENANCE_SCHEMA`
    export.json              the summary

`state` and `action` are lists of the embodiment's own width; their joint names are in the schema metadata, key "domino".
An image is a struct {bytes, path}, as Hugging Face datasets stores images: `load_dataset("parquet", data_files=...)` with
"OUT/data-*.parquet" decodes them; everything else reads the bytes.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.data.episode import EpisodeFile
from pipeline.export.common import (
    EXPORT_FAULTS,
    ExportError,
    Facts,
    event_frames,
    exported_cameras,
    judging,
    ordered,
    read_facts,
    reading,
    same,
    staged,
)
from pipeline.export.exporter import Exporter, Job, register
from pipeline.export.options import camera_names_option, option, whole
from pipeline.export.provenance import PROVENANCE, Provenance, check_provenance

FILE_BYTES = 200 * 1024 * 1024
IMAGE = pa.struct({"bytes": pa.binary(), "path": pa.string()})  # what Hugging Face datasets stores an image as
VECTORS = ("state", "action", "target_pose", "target_velocity", "tcp_left", "tcp_right")
CONSTANTS = {"task": pa.string(), "embodiment": pa.string(), "level": pa.int64(), "alpha": pa.float64(), "domain": pa.string()} | {
    "slot": pa.int64(),
    "seed": pa.int64(),
    "physics_id": pa.string(),
    "variant": pa.int64(),
    "instruction": pa.string(),
}


@dataclass(frozen=True)
class ParquetOptions:
    """Options of the Parquet format: a new file begins when one has reached `file_bytes`."""

    file_bytes: int = option("bytes after which another file begins", whole(1), FILE_BYTES)
    camera_names: Mapping[str, str] = camera_names_option()


def image_columns(facts: Facts, options: ParquetOptions) -> dict[str, str]:
    """Camera -> column of its JPEG bytes: "left_camera" -> "image_cam_left_wrist"."""
    return {camera: f"image_{name}" for camera, name in exported_cameras(facts, options.camera_names).items()}


def _schema(fps: int, columns_of_images: Sequence[str], names: dict[str, list[str]]) -> pa.Schema:
    """The schema with fps, joint names by embodiment and the Hugging Face feature of every column in its metadata."""
    columns: dict[str, pa.DataType] = {"episode_index": pa.int64(), "frame_index": pa.int64(), "timestamp": pa.float64()}
    columns |= CONSTANTS
    columns |= dict.fromkeys(VECTORS, pa.list_(pa.float32()))
    columns |= {"events": pa.list_(pa.string()), "event_times": pa.list_(pa.float64())}
    columns |= {"is_first": pa.bool_(), "is_last": pa.bool_()}
    images = dict.fromkeys(columns_of_images, IMAGE)
    schema = pa.schema([*columns.items(), *images.items()])
    features = {field.name: _feature(field.type) for field in schema}
    metadata = {
        "huggingface": json.dumps({"info": {"features": features}}),
        "domino": json.dumps({"fps": fps, "cameras": list(columns_of_images), "names": names}, sort_keys=True),
    }
    return schema.with_metadata(metadata)


def _feature(kind: pa.DataType) -> dict[str, Any]:
    """The Hugging Face feature of an Arrow type."""
    if kind == IMAGE:
        return {"_type": "Image"}
    if isinstance(kind, pa.ListType):
        return {"feature": _feature(kind.value_type), "_type": "List"}
    return {"dtype": {"double": "float64", "float": "float32"}.get(str(kind), str(kind)), "_type": "Value"}


def _table(index: int, facts: Facts, file: EpisodeFile, images: Mapping[str, str], schema: pa.Schema) -> pa.Table:
    frames, log = len(facts), facts.log
    spec = {name: value for name, value in vars(facts.spec).items() if name in CONSTANTS}
    spec |= {"physics_id": facts.meta.physics_id, "variant": facts.meta.variant, "instruction": facts.instruction}
    columns: dict[str, Any] = {name: pa.array([value] * frames, CONSTANTS[name]) for name, value in spec.items()}
    columns["episode_index"] = np.full(frames, index)
    columns["frame_index"] = np.arange(frames)
    columns["timestamp"] = log.times - log.times[0]
    values = (log.state, log.action, facts.target, log.target_velocity, log.tcp[:, 0], log.tcp[:, 1])
    for name, value in zip(VECTORS, values, strict=True):
        columns[name] = pa.array(list(value.astype(np.float32)), pa.list_(pa.float32()))
    names: list[list[str]] = [[] for _ in range(frames)]
    times: list[list[float]] = [[] for _ in range(frames)]
    for frame, name, time in event_frames(facts):
        names[frame].append(name)
        times[frame].append(time - float(log.times[0]))
    columns["events"], columns["event_times"] = names, times
    columns["is_first"] = np.arange(frames) == 0
    columns["is_last"] = np.arange(frames) == frames - 1
    for camera, column in images.items():
        coded = file.array(f"observation/{camera}/rgb").tolist()
        columns[column] = pa.array([{"bytes": jpeg, "path": None} for jpeg in coded], IMAGE)
    return pa.table({name: columns[name] for name in schema.names}, schema=schema)


@register
class Parquet(Exporter[ParquetOptions]):
    """One row a frame; mixed embodiments share the files."""

    name = "parquet"
    options = ParquetOptions

    def export(self, job: Job[ParquetOptions]) -> dict[str, Any]:
        """Write `job.out`. Raises ExportError for unreadable episodes, and for episodes that differ in fps or cameras."""
        paths = ordered(job.episodes)
        with staged(job.out, job.dataset) as folder:
            firsts = _firsts(paths, job.dataset)
            reference = next(iter(firsts.values()))
            images = image_columns(reference, job.options)
            names = {name: list(f.log.vector_names) for name, f in firsts.items()}
            schema = _schema(reference.fps, list(images.values()), names)
            files = _Files(folder, schema, list(images.values()), job.options.file_bytes)
            rows = Provenance(folder / PROVENANCE)
            frames = 0
            with closing(rows), closing(files):
                for index, path in enumerate(paths):
                    with reading(path) as file:
                        facts = read_facts(file, job.dataset)
                        same(firsts[facts.spec.embodiment], facts)
                        table = _table(index, facts, file, images, schema)
                    files.write(table)
                    frames += len(table)
                    rows.append(facts)
                    job.advance()
            values = {"episodes": len(paths), "frames": frames, "files": files.count, "fps": reference.fps}
            return self.summarize(folder, job, values | {"embodiments": sorted(firsts)})

    def check(self, dataset: Path, out: Path, episodes: Sequence[Path]) -> list[str]:
        """Every value and every byte of the images must be the episode's."""
        paths = ordered(episodes)
        files = sorted(out.glob("data-*.parquet"))
        problems: list[str] = []
        try:
            options = self.options_of(out)
            groups = [(f, i) for f in files for i in range(pq.read_metadata(f).num_row_groups)]
        except (*EXPORT_FAULTS, ExportError, pa.ArrowException) as error:
            return [f"{out}: cannot be read ({' '.join(str(error).split())})"]
        if len(groups) != len(paths):
            problems.append(f"{out}: has {len(groups)} row groups for {len(paths)} episodes")
        for index, (path, (name, group)) in enumerate(zip(paths, groups, strict=False)):
            with reading(path) as file:
                facts = read_facts(file, dataset)
                where = f"{name}, row group {group}"
                with judging(name, problems):
                    with pq.ParquetFile(name) as source:
                        got = source.read_row_group(group)
                    want = _table(index, facts, file, image_columns(facts, options), got.schema)
                    if len(got) != len(want):
                        problems.append(f"{where}: {len(got)} rows for {len(want)} frames of {path}")
                        continue
                    differ = [c for c in want.column_names if not got[c].equals(want[c])]
                    problems += [f"{where}: column {c} differs from {path}" for c in differ]
        with judging(out / PROVENANCE, problems):
            problems += check_provenance(out / PROVENANCE, dataset, paths)
        return problems


class _Files:
    """data-00000.parquet ...: a table is a row group; a new file begins when one has reached `limit` bytes."""

    def __init__(self, folder: Path, schema: pa.Schema, images: list[str], limit: int) -> None:
        self.folder, self.schema, self.limit, self.count = folder, schema, limit, 0
        # JPEG bytes neither compress nor repeat
        codecs = {name: "ZSTD" for name in schema.names if name not in images} | {f"{name}.bytes": "NONE" for name in images}
        self.options: dict[str, Any] = {"compression": codecs, "use_dictionary": [*CONSTANTS]}
        self._writer: pq.ParquetWriter | None = None

    def write(self, table: pa.Table) -> None:
        if self._writer is None:
            self._writer = pq.ParquetWriter(self.folder / f"data-{self.count:05d}.parquet", self.schema, **self.options)
            self.count += 1
        self._writer.write_table(table, row_group_size=len(table))
        if (self.folder / f"data-{self.count - 1:05d}.parquet").stat().st_size >= self.limit:
            self.close()

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def _firsts(paths: Sequence[Path], dataset: Path) -> dict[str, Facts]:
    """Embodiment -> its first episode; raises ExportError where two of these differ in fps or cameras."""
    firsts: dict[str, Facts] = {}
    for path in paths:
        with reading(path) as file:
            if file.spec.embodiment not in firsts:
                firsts[file.spec.embodiment] = read_facts(file, dataset)
    reference, *others = firsts.values()
    for other in others:
        for name, want, got in (("fps", reference.fps, other.fps), ("cameras", reference.cameras, other.cameras)):
            if want != got:
                raise ExportError(f"{other.source}: {name} {got} differs from {want} of {reference.source}; export them separately")
    return firsts

"""Schema, info.json, tasks and statistics, with the bytes that lerobot 0.6.1 writes."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.export.shared.images import DEPTH, IMAGE, image_column
from pipeline.export.shared.statistics import Stats
from pipeline.export.shared.tables import TableWriter

FILES_PER_CHUNK = 1000


def chunk_file(number: int, suffix: str) -> str:
    """Name of file number `number`: chunk-000/file-000 ..., 1000 files a chunk."""
    return f"chunk-{number // FILES_PER_CHUNK:03d}/file-{number % FILES_PER_CHUNK:03d}.{suffix}"


class Tables:
    """Parquet files of one schema; `number` is the current one's."""

    def __init__(self, root: Path, schema: pa.Schema) -> None:
        self.root, self.schema = root, schema
        self.number = 0
        self._writer: TableWriter | None = None

    @property
    def size(self) -> int:
        path = self.root / chunk_file(self.number, "parquet")
        return path.stat().st_size if self._writer is not None else 0

    def roll(self) -> None:
        self.close()
        self.number += 1

    @property
    def place(self) -> dict[str, int]:
        chunk, file = divmod(self.number, FILES_PER_CHUNK)
        return {"chunk_index": chunk, "file_index": file}

    def write(self, table: pa.Table) -> None:
        path = self.root / chunk_file(self.number, "parquet")
        if self._writer is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = TableWriter(path, self.schema, compression="snappy", use_dictionary=True)
        self._writer.write_table(table, row_group_size=max(len(table), 1))

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def read_column(root: Path, name: str) -> NDArray[Any]:
    """A column of all Parquet files below a directory, (N,) or (N,d)."""
    parts = list[NDArray[Any]]()
    for path in sorted(root.rglob("*.parquet")):
        table = pq.ParquetFile(path).read(columns=[name], use_threads=False)
        column = table[name].combine_chunks()
        if pa.types.is_fixed_size_list(column.type):
            parts.append(column.flatten().to_numpy().reshape(len(column), -1))
        else:
            parts.append(column.to_numpy())
    return np.concatenate(parts)


def depth_schema(names: Sequence[str]) -> pa.Schema:
    clock = [(name, pa.int64()) for name in ("index", "episode_index", "frame_index")]
    return pa.schema(clock + [(f"{DEPTH}_{name}", IMAGE) for name in names])


def depth_table(
    images: Mapping[str, Sequence[bytes]], schema: pa.Schema, index: int, start: int
) -> pa.Table:
    """Rows of episode `index` from frame `start`; PNG by camera."""
    count = len(next(iter(images.values())))
    clock = [np.arange(start, start + count), np.full(count, index), np.arange(count)]
    return pa.table([*map(pa.array, clock), *map(image_column, images.values())], schema=schema)


PANDAS_LAYOUT = "2.3.3"
"""The version of pandas whose description of an index tasks.parquet carries."""

DEFAULTS = {
    "chunks_size": FILES_PER_CHUNK,
    "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
}
ORDER = (
    *("codebase_version", "fps", "features", "total_episodes", "total_frames", "total_tasks"),
    *("chunks_size", "data_files_size_in_mb", "video_files_size_in_mb"),
    *("data_path", "video_path", "robot_type", "splits"),
)


def data_schema(features: Mapping[str, Mapping[str, Any]]) -> pa.Schema:
    stored = {name: feature for name, feature in features.items() if feature["dtype"] != "video"}
    kinds = {name: _column(feature) for name, feature in stored.items()}
    described = {"info": {"features": {name: words for name, (_, words) in kinds.items()}}}
    return pa.schema(
        [(name, kind) for name, (kind, _) in kinds.items()],
        metadata={"huggingface": json.dumps(described)},
    )


def _column(feature: Mapping[str, Any]) -> tuple[pa.DataType, dict[str, Any]]:
    kind, (length,) = feature["dtype"], feature["shape"]
    arrow, value = pa.type_for_alias(kind), {"dtype": kind, "_type": "Value"}
    if length == 1:
        return arrow, value
    return pa.list_(arrow, length), {"feature": value, "length": length, "_type": "List"}


def write_meta(
    root: Path, info: Mapping[str, Any], tasks: Sequence[str], stats: Mapping[str, Stats]
) -> None:
    """Write info.json (`info` over DEFAULTS), tasks.parquet and stats.json."""
    meta = root / "meta"
    meta.mkdir(parents=True, exist_ok=True)
    _write_json(meta / "info.json", {name: (DEFAULTS | dict(info))[name] for name in ORDER})
    pq.write_table(_tasks_table(tasks), meta / "tasks.parquet")
    plain = {key: {stat: v.tolist() for stat, v in entry.items()} for key, entry in stats.items()}
    _write_json(meta / "stats.json", plain)


def _tasks_table(tasks: Sequence[str]) -> pa.Table:
    def column(name: str | None, kind: str, stored: str, metadata: Any = None) -> dict[str, Any]:
        names = {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored}
        return names | {"metadata": metadata}

    pandas = {
        "index_columns": ["task"],
        "column_indexes": [column(None, "unicode", "object", {"encoding": "UTF-8"})],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "attributes": {},
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": PANDAS_LAYOUT,
    }
    columns = {"task_index": pa.array(range(len(tasks)), pa.int64())}
    table = pa.table(columns | {"task": pa.array(tasks, "string")})
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def _write_json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=4, ensure_ascii=False), encoding="utf-8")

"""Numbered Parquet files. Depth (16-bit PNG, mm) is apart: policies take features for RGB."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.export.shared.images import DEPTH, IMAGE, image_column
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
        """Bytes of the file that the next table goes to."""
        path = self.root / chunk_file(self.number, "parquet")
        return path.stat().st_size if self._writer is not None else 0

    def roll(self) -> None:
        self.close()
        self.number += 1

    @property
    def place(self) -> dict[str, int]:
        """The chunk_index and file_index of the next table."""
        chunk, file = divmod(self.number, FILES_PER_CHUNK)
        return {"chunk_index": chunk, "file_index": file}

    def write(self, table: pa.Table) -> None:
        """Append a table as one row group."""
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
    """Three clock columns, and one of images for each camera."""
    clock = [(name, pa.int64()) for name in ("index", "episode_index", "frame_index")]
    return pa.schema(clock + [(f"{DEPTH}_{name}", IMAGE) for name in names])


def depth_table(
    images: Mapping[str, Sequence[bytes]], schema: pa.Schema, index: int, start: int
) -> pa.Table:
    """Rows of episode `index` from frame `start`; PNG by camera."""
    count = len(next(iter(images.values())))
    clock = [np.arange(start, start + count), np.full(count, index), np.arange(count)]
    return pa.table([*map(pa.array, clock), *map(image_column, images.values())], schema=schema)

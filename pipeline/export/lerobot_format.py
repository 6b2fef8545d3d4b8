"""What the files of a LeRobot v3.0 dataset look like: features, schemas, names and metadata files, written with pyarrow alone.

Importing the lerobot package costs half a minute of CPU (torch, transformers); the format does not need it. The tests hold these
files against those that lerobot itself writes for the same episode, and load them with it.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.export.common import Facts, camera_label
from pipeline.export.provenance import SCALAR_TYPES
from pipeline.export.stats import Stats
from pipeline.export.video import Codec

VERSION = "v3.0"
FILES_PER_CHUNK = 1000
MEGABYTE = 1024**2
POSE_NAMES = ["x", "y", "z", "qw", "qx", "qy", "qz"]
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
CLOCK_FEATURES = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64"}


def image_key(camera: str) -> str:
    """Feature of a camera: "left_camera" -> "observation.images.left_wrist"."""
    return f"observation.images.{camera_label(camera)}"


def chunk_file(number: int, suffix: str) -> str:
    """Name of file number `number`: chunk-000/file-000 ..., 1000 files a chunk."""
    return f"chunk-{number // FILES_PER_CHUNK:03d}/file-{number % FILES_PER_CHUNK:03d}.{suffix}"


def features_of(facts: Facts, codec: Codec) -> dict[str, dict[str, Any]]:
    """Features of the episodes of an embodiment in the order of the columns; joint names from the file, the clock features last."""
    joints = list(facts.log.vector_names)
    numbers = {"observation.state": joints, "action": joints, "target.pose": POSE_NAMES, "target.velocity": ["vx", "vy", "vz"]}
    features: dict[str, dict[str, Any]] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": names} for name, names in numbers.items()
    }
    for camera in facts.cameras:
        shape = {"dtype": "video", "shape": [*facts.size, 3], "names": ["height", "width", "channels"]}
        features[image_key(camera)] = shape | {"info": _video_info(facts, codec)}
    return features | {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in CLOCK_FEATURES.items()}


def _video_info(facts: Facts, codec: Codec) -> dict[str, Any]:
    preset = codec.options()["preset"]
    return {
        "video.height": facts.size[0],
        "video.width": facts.size[1],
        "video.codec": {"libsvtav1": "av1"}.get(codec.name, codec.name),
        "video.pix_fmt": codec.pix_fmt,
        "video.fps": facts.fps,
        "video.channels": 3,
        "has_audio": False,
        "video.g": codec.gop,
        "video.crf": codec.crf,
        "video.preset": int(preset) if preset.isdigit() else preset,
        "video.fast_decode": 0,
        "video.video_backend": "pyav",
        "video.extra_options": {},
        "is_depth_map": False,
    }


def data_schema(features: dict[str, dict[str, Any]]) -> pa.Schema:
    """Schema of the data files: every feature but the videos, with Hugging Face features in the metadata."""
    fields, described = [], {}
    for name, feature in features.items():
        if feature["dtype"] == "video":
            continue
        value = {"dtype": feature["dtype"], "_type": "Value"}
        kind = pa.float32() if feature["dtype"] == "float32" else pa.int64()
        (length,) = feature["shape"]
        fields.append(pa.field(name, kind if name in CLOCK_FEATURES else pa.list_(kind, length)))
        described[name] = value if name in CLOCK_FEATURES else {"feature": value, "length": length, "_type": "List"}
    return pa.schema(fields, metadata={"huggingface": json.dumps({"info": {"features": described}})})


def data_table(columns: dict[str, NDArray[Any]], schema: pa.Schema) -> pa.Table:
    """Rows of a data file from columns (T,) or (T,d)."""
    arrays = []
    for field in schema:
        values = columns[field.name]
        flat = pa.array(values.ravel())
        arrays.append(flat if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, type=field.type))
    return pa.Table.from_arrays(arrays, schema=schema)


def data_columns(facts: Facts, index: int, start: int, task: int) -> dict[str, NDArray[Any]]:
    """Columns (T,) or (T,d) of an episode: number `index`, first row `start` of the dataset, instruction number `task`."""
    length = len(facts)
    return {
        "observation.state": facts.log.state.astype(np.float32),
        "action": facts.log.action.astype(np.float32),
        "target.pose": facts.target.astype(np.float32),
        "target.velocity": facts.log.target_velocity.astype(np.float32),
        "timestamp": (np.arange(length) / facts.fps).astype(np.float32),
        "frame_index": np.arange(length),
        "episode_index": np.full(length, index),
        "index": np.arange(start, start + length),
        "task_index": np.full(length, task),
    }


def episode_schema(row: dict[str, Any], stats: dict[str, Stats]) -> pa.Schema:
    """Schema of meta/episodes from one row of it and the statistics in it; the place of the row itself comes last."""
    types: dict[str, pa.DataType] = {}
    for name, value in row.items():
        if name.startswith("domino."):
            types[name] = SCALAR_TYPES[name.removeprefix("domino.")]
        elif name.startswith("stats/"):
            _, feature, stat = name.split("/")
            types[name] = pa.int64() if stat == "count" else pa.float64()
            for _ in range(stats[feature][stat].ndim):
                types[name] = pa.list_(types[name])
        elif name == "tasks":
            types[name] = pa.list_(pa.string())
        else:
            types[name] = pa.int64() if isinstance(value, int) else pa.float64()
    return pa.schema([*types.items(), ("meta/episodes/chunk_index", pa.int64()), ("meta/episodes/file_index", pa.int64())])


def write_tasks(path: Path, tasks: list[str]) -> None:
    """meta/tasks.parquet: pandas must find the instruction as the index, so its metadata is written too."""
    text = {"pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    number = {"pandas_type": "int64", "numpy_type": "int64", "metadata": None}
    names = ("task_index", "task")
    columns = [{"name": n, "field_name": n, **kind} for n, kind in zip(names, (number, text), strict=True)]
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    schema = pa.schema([("task_index", pa.int64()), ("task", pa.string())], metadata={"pandas": json.dumps(pandas)})
    pq.write_table(pa.table({"task_index": range(len(tasks)), "task": tasks}, schema=schema), path)


def write_info(
    path: Path, facts: Facts, features: dict[str, Any], counts: tuple[int, int, int], data_bytes: int, video_bytes: int
) -> None:
    """meta/info.json; counts: episodes, frames, tasks."""
    episodes, frames, tasks = counts
    info = {
        "codebase_version": VERSION,
        "fps": facts.fps,
        "features": features,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": max(1, data_bytes // MEGABYTE),
        "video_files_size_in_mb": max(1, video_bytes // MEGABYTE),
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH,
        "robot_type": facts.spec.embodiment,
        "splits": {"train": f"0:{episodes}"},
    }
    path.write_text(json.dumps(info, indent=4) + "\n")


def write_stats(path: Path, stats: dict[str, Stats]) -> None:
    """meta/stats.json."""
    plain = {feature: {name: value.tolist() for name, value in entry.items()} for feature, entry in stats.items()}
    path.write_text(json.dumps(plain, indent=4) + "\n")


def modality(facts: Facts) -> dict[str, Any]:
    """meta/modality.json as GR00T and its forks read it: slices of the vectors, names of the videos and of the instruction."""
    parts: dict[str, dict[str, int]] = {}
    for i, name in enumerate(facts.log.vector_names):
        side = name.split("_")[0]
        part = f"{side}_gripper" if name == f"{side}_gripper" else f"{side}_arm"
        parts.setdefault(part, {"start": i, "end": i})["end"] = i + 1
    return {
        "state": parts,
        "action": parts,
        "video": {camera_label(c): {"original_key": image_key(c)} for c in facts.cameras},
        "annotation": {"human.action.task_description": {"original_key": "task_index"}},
    }


class Tables:
    """Parquet files chunk-000/file-000.parquet ... of one schema; a new one begins whenever `limit` bytes are reached."""

    def __init__(self, root: Path, schema: pa.Schema, limit: int) -> None:
        self.root, self.schema, self.limit = root, schema, limit
        self.number = 0
        self._writer: pq.ParquetWriter | None = None

    @property
    def place(self) -> dict[str, int]:
        """chunk_index and file_index of the file that the next table goes to."""
        return {"chunk_index": self.number // FILES_PER_CHUNK, "file_index": self.number % FILES_PER_CHUNK}

    def write(self, table: pa.Table) -> None:
        """Append a table as one row group."""
        path = self.root / chunk_file(self.number, "parquet")
        if self._writer is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(path, self.schema, compression="snappy", use_dictionary=True)
        self._writer.write_table(table, row_group_size=max(len(table), 1))
        if path.stat().st_size >= self.limit:
            self.close()
            self.number += 1

    def close(self) -> None:
        """Write the footer."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def column(self, name: str) -> NDArray[Any]:
        """A column of all closed files, (N,) or (N,d)."""
        files = sorted(self.root.rglob("*.parquet"))
        chunks = [pq.read_table(p, columns=[name])[name].combine_chunks() for p in files]
        if isinstance(self.schema.field(name).type, pa.FixedSizeListType):
            return np.concatenate([c.flatten().to_numpy().reshape(len(c), -1) for c in chunks])
        return np.concatenate([c.to_numpy() for c in chunks])

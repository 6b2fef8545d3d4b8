"""LeRobot v3.0: Parquet for numbers, one growing mp4 per camera, metadata by the lerobot package.

Numbers, videos and episode rows are written directly, each byte once; lerobot's own classes write info, tasks and statistics.
What it holds beyond the format: `target.pose` and `target.velocity` in every frame, `domino.*` columns in meta/episodes (so that
`filter_episodes` can select on level, alpha, seed...), meta/domino_episodes.parquet (all instructions, motion, objects, events),
meta/domino.json and meta/modality.json (GR00T). One dataset per embodiment: `out`, or `out/<embodiment>` for several.

`observation.state` is measured at the frame, `action` is the joint target commanded for the interval after it; nothing is shifted.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.export.common import (
    SCALAR_TYPES,
    SUMMARY,
    ExportError,
    Facts,
    Progress,
    by_embodiment,
    camera_label,
    provenance,
    read_facts,
    reading,
    same,
    scalars,
    size_of,
    staged,
    write_json,
    write_provenance,
)
from pipeline.export.stats import Stats, color_counts, picture_stats, sample_rows, vector_stats
from pipeline.export.video import Codec, VideoFile, encode

DATA_BYTES = 100 * 1024**2
VIDEO_BYTES = 200 * 1024**2
# lerobot compares float32 times within 1e-4 s: beyond 1024 s neighbouring float32 numbers are further apart than that
VIDEO_SECONDS = 1000
FILES_PER_CHUNK = 1000
ROWS_PER_GROUP = 100
POSE_NAMES = ["x", "y", "z", "qw", "qx", "qy", "qz"]


@dataclass(frozen=True, eq=False)
class Prepared:
    """An episode ready to be appended: facts, mp4 bytes by camera, colour counts (3,256) by camera over `sampled` pictures."""

    facts: Facts
    videos: dict[str, bytes]
    colors: dict[str, NDArray[np.int64]]
    sampled: int


def image_key(camera: str) -> str:
    """Feature of a camera: "left_camera" -> "observation.images.left_wrist"."""
    return f"observation.images.{camera_label(camera)}"


def features_of(facts: Facts) -> dict[str, dict[str, Any]]:
    """LeRobot features of the episodes of an embodiment, joint names from the file."""
    joints = list(facts.log.vector_names)
    numbers = {"observation.state": joints, "action": joints, "target.pose": POSE_NAMES, "target.velocity": ["vx", "vy", "vz"]}
    features = {k: {"dtype": "float32", "shape": (len(names),), "names": names} for k, names in numbers.items()}
    picture = {"dtype": "video", "shape": (*facts.size, 3), "names": ["height", "width", "channels"]}
    return features | {image_key(c): dict(picture) for c in facts.cameras}


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


def prepare(path: Path, dataset: Path, codec: Codec) -> Prepared:
    """Read and encode one episode. Raises ExportError for a bad file or a picture size that 4:2:0 video cannot hold."""
    with reading(path) as file:
        facts = read_facts(file, dataset)
        if facts.size[0] % 2 or facts.size[1] % 2:
            raise ExportError(f"{path}: pictures of {facts.size} cannot become video; height and width must be even")
        rows = sample_rows(len(facts))
        videos, colors = {}, {}
        for camera in facts.cameras:
            frames = list(file.frames(camera))
            colors[camera] = color_counts([frames[i] for i in rows])
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
        finally:
            for future in pending:
                future.cancel()


class Tables:
    """Parquet files chunk-000/file-000.parquet ... of one schema, a new one whenever `limit` bytes are reached."""

    def __init__(self, root: Path, schema: pa.Schema, limit: int) -> None:
        self.root, self.schema, self.limit = root, schema, limit
        self.number = 0
        self._writer: pq.ParquetWriter | None = None

    def path(self) -> Path:
        """The file the next table goes to."""
        return self.root / chunk_file(self.number, "parquet")

    def write(self, table: pa.Table) -> None:
        """Append a table as one row group."""
        if self._writer is None:
            self.path().parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(self.path(), self.schema, compression="snappy", use_dictionary=True)
        self._writer.write_table(table, row_group_size=max(len(table), 1))
        if self.path().stat().st_size >= self.limit:
            self.close()
            self.number += 1

    def close(self) -> None:
        """Write the footer."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def chunk_file(number: int, suffix: str) -> str:
    """LeRobot's name of file number `number`: 1000 files a chunk."""
    return f"chunk-{number // FILES_PER_CHUNK:03d}/file-{number % FILES_PER_CHUNK:03d}.{suffix}"


def export_lerobot(
    dataset: Path,
    out: Path,
    episodes: Sequence[Path],
    *,
    progress: Progress = None,
    codec: Codec | None = None,
    workers: int = 1,
    data_bytes: int = DATA_BYTES,
    video_bytes: int = VIDEO_BYTES,
) -> dict[str, Any]:
    """Write `out` (or `out/<embodiment>` for several); `progress(1)` after each episode. Returns the summary.

    codec: AV1 as LeRobot does by default. workers: processes that encode; the output does not depend on it. A file is closed at
    data_bytes or video_bytes or VIDEO_SECONDS. Raises ExportError for unreadable episodes, for episodes of one embodiment that
    differ in fps, cameras, picture size or joint names, and without the lerobot package.
    """
    codec = codec or Codec()
    limits = (data_bytes, video_bytes)
    with staged(out, dataset) as folder:
        groups = by_embodiment(episodes, folder)
        parts = {}
        for name, (root, paths) in groups.items():
            prepared = prepare_all(paths, dataset, codec, min(workers, len(paths)))
            parts[name] = _write_dataset(root, f"domino/{name}", prepared, codec, limits, progress)
        summary = {"format": "lerobot", "version": "v3.0", "embodiments": sorted(parts), "codec": codec.name}
        summary |= {key: sum(p[key] for p in parts.values()) for key in ("episodes", "frames")}
        summary |= {"fps": {name: p["fps"] for name, p in parts.items()}, "bytes": size_of(folder)}
        write_json(folder / SUMMARY, summary)
    return summary


def _write_dataset(
    root: Path, repo_id: str, prepared: Iterator[Prepared], codec: Codec, limits: tuple[int, int], progress: Progress
) -> dict[str, Any]:
    try:
        from lerobot.datasets.feature_utils import get_hf_features_from_features
        from lerobot.datasets.io_utils import write_info, write_stats, write_tasks
        from lerobot.datasets.lerobot_dataset import LeRobotDatasetMetadata
    except ImportError as error:
        raise ExportError(f"the lerobot export needs the lerobot package ({error}): install domino-data[lerobot]") from error
    import pandas as pd

    meta: Any = None
    first: Facts | None = None
    data: Tables | None = None
    videos: dict[str, VideoFile] = {}
    numbers: dict[str, int] = {}
    tasks: dict[str, int] = {}
    rows: list[dict[str, Any]] = []
    provenances: list[dict[str, Any]] = []
    colors: dict[str, NDArray[np.int64]] = {}
    sampled, frames = 0, 0
    rows_to: Tables | None = None
    try:
        for index, episode in enumerate(prepared):
            facts = episode.facts
            if first is None:
                first = facts
                if root.exists():
                    root.rmdir()  # lerobot wants to make it itself
                meta = LeRobotDatasetMetadata.create(repo_id, facts.fps, features_of(facts), facts.spec.embodiment, root)
                data = Tables(root / "data", get_hf_features_from_features(meta.features).arrow_schema, limits[0])
            same(first, facts)
            assert data is not None
            length = len(facts)
            task = tasks.setdefault(facts.instruction, len(tasks))
            columns = _columns(facts, index, frames, task)
            row: dict[str, Any] = {"episode_index": index, "tasks": [facts.instruction], "length": length}
            row |= {"data/chunk_index": data.number // FILES_PER_CHUNK, "data/file_index": data.number % FILES_PER_CHUNK}
            row |= {"dataset_from_index": frames, "dataset_to_index": frames + length}
            data.write(_data_table(columns, data.schema))
            stats: dict[str, Stats] = {name: vector_stats(values) for name, values in columns.items()}
            for camera, mp4 in episode.videos.items():
                key = image_key(camera)
                row |= _append_video(root, key, mp4, facts, videos, numbers, limits[1])
                stats[key] = picture_stats(episode.colors[camera], episode.sampled)
                colors[key] = colors.get(key, 0) + episode.colors[camera]
            row |= {f"stats/{name}/{stat}": v.tolist() for name, s in stats.items() for stat, v in s.items()}
            row |= {f"domino.{k}": v for k, v in scalars(facts).items()}
            rows_to = rows_to or Tables(root / "meta" / "episodes", _episode_schema(row, stats), limits[0])
            rows.append(row)
            provenances.append(provenance(index, facts))
            sampled += episode.sampled
            frames += length
            if len(rows) == ROWS_PER_GROUP:
                _flush(rows, rows_to)
            if progress:
                progress(1)
        assert first is not None and rows_to is not None and data is not None
        if rows:
            _flush(rows, rows_to)
    finally:
        for closing in (data, rows_to, *videos.values()):
            if closing is not None:
                closing.close()
    total = {name: vector_stats(_read_column(root, name)) for name in data.schema.names}
    total |= {key: picture_stats(counts, sampled) for key, counts in colors.items()}
    write_stats(total, root)
    write_tasks(pd.DataFrame({"task_index": list(tasks.values())}, index=pd.Index(list(tasks), name="task")), root)
    info = meta.info
    info.total_episodes, info.total_frames, info.total_tasks = len(provenances), frames, len(tasks)
    info.splits = {"train": f"0:{len(provenances)}"}
    info.data_files_size_in_mb, info.video_files_size_in_mb = (max(1, n // 1024**2) for n in limits)
    for key in colors:
        meta.update_video_info(key, _encoder_config(codec))
    write_info(info, root)
    write_provenance(root / "meta" / "domino_episodes.parquet", provenances)
    write_json(root / "meta" / "modality.json", modality(first))
    summary = {"episodes": len(provenances), "frames": frames, "fps": first.fps, "embodiment": first.spec.embodiment}
    write_json(
        root / "meta" / "domino.json",
        {**summary, "names": list(first.log.vector_names), "code_version": first.meta.get("code_version")},
    )
    return summary


def _columns(facts: Facts, index: int, start: int, task: int) -> dict[str, NDArray[Any]]:
    """Values (T,) or (T,d) of all columns of the data files, in the order of the features."""
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


def _data_table(columns: dict[str, NDArray[Any]], schema: pa.Schema) -> pa.Table:
    arrays = []
    for field in schema:
        values = columns[field.name]
        if values.ndim == 2:
            arrays.append(pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1]).cast(field.type))
        else:
            arrays.append(pa.array(values, field.type))
    return pa.Table.from_arrays(arrays, schema=schema)


def _append_video(
    root: Path, key: str, mp4: bytes, facts: Facts, videos: dict[str, VideoFile], numbers: dict[str, int], limit: int
) -> dict[str, Any]:
    length = len(facts)
    current = videos.get(key)
    if current is not None and (current.size + len(mp4) > limit or current.frames + length > VIDEO_SECONDS * facts.fps):
        current.close()
        numbers[key] += 1
        current = None
    if current is None:
        number = numbers.setdefault(key, 0)
        current = videos[key] = VideoFile(root / "videos" / key / chunk_file(number, "mp4"), facts.fps)
    try:
        start, end = current.append(mp4, length)
    except ValueError as error:
        raise ExportError(f"{facts.source}: {key}: {error}") from error
    chunk, file = divmod(numbers[key], FILES_PER_CHUNK)
    place = {"chunk_index": chunk, "file_index": file, "from_timestamp": start, "to_timestamp": end}
    return {f"videos/{key}/{name}": value for name, value in place.items()}


def _episode_schema(row: dict[str, Any], stats: dict[str, Stats]) -> pa.Schema:
    """Schema of meta/episodes: the columns of a row, then the place of the row itself."""
    types: dict[str, pa.DataType] = {}
    for name, value in row.items():
        if name.startswith("domino."):
            types[name] = SCALAR_TYPES[name.removeprefix("domino.")]
        elif name.startswith("stats/"):
            _, feature, stat = name.split("/")
            kind = pa.int64() if stat == "count" else pa.float64()
            for _ in range(stats[feature][stat].ndim):
                kind = pa.list_(kind)
            types[name] = kind
        elif name == "tasks":
            types[name] = pa.list_(pa.string())
        else:
            types[name] = pa.int64() if isinstance(value, int) else pa.float64()
    return pa.schema([*types.items(), ("meta/episodes/chunk_index", pa.int64()), ("meta/episodes/file_index", pa.int64())])


def _flush(rows: list[dict[str, Any]], tables: Tables) -> None:
    chunk, file = divmod(tables.number, FILES_PER_CHUNK)
    place = {"meta/episodes/chunk_index": chunk, "meta/episodes/file_index": file}
    tables.write(pa.Table.from_pylist([row | place for row in rows], schema=tables.schema))
    rows.clear()


def _read_column(root: Path, name: str) -> NDArray[Any]:
    """A column of all data files, (N,) or (N,d)."""
    chunks = [pq.read_table(p, columns=[name])[name].combine_chunks() for p in sorted((root / "data").rglob("*.parquet"))]
    if pa.types.is_fixed_size_list(chunks[0].type):
        return np.concatenate([c.flatten().to_numpy().reshape(-1, c.type.list_size) for c in chunks])
    return np.concatenate([c.to_numpy() for c in chunks])


def _encoder_config(codec: Codec) -> Any:
    """The settings as lerobot records them in info.json."""
    from lerobot.configs import RGBEncoderConfig

    preset = codec.options()["preset"]
    return RGBEncoderConfig(
        vcodec=codec.name, pix_fmt=codec.pix_fmt, g=codec.gop, crf=codec.crf, preset=int(preset) if preset.isdigit() else preset
    )

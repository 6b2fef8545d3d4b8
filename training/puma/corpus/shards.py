"""Episodes of a dataset's Parquet export with their annotations; the command that makes a missing
or stale export."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.data.dataset import Dataset
from pipeline.data.keys import digest, frames_digest
from pipeline.data.names import EXPORTED_CAMERAS
from pipeline.data.slots.select import COLUMNS, parse_where, select_rows
from training.puma.config import Config, MixtureSource
from training.puma.corpus.annotations import NeededAnnotations
from training.puma.errors import TrainError

EXPORT = "parquet"


@dataclass(frozen=True)
class Row:
    """One episode of the export: its number there, where it came from, and what it says about
    itself.

    `instructions` are those for training, `unseen` those kept for evaluation. `length` counts the
    frames that are read (`data.after_success`). From frame `taught` on the expert acts: 0 until the
    episode has been read. Before it, in a corrected episode, a policy acts.
    """

    index: int
    source: str
    length: int
    embodiment: str
    physics_id: str
    target: str
    instructions: tuple[str, ...]
    unseen: tuple[str, ...] = ()
    taught: int = 0

    @property
    def path(self) -> Path:
        """The episode file, relative to the dataset's episodes/."""
        return Path(self.source).relative_to("episodes")


@dataclass(eq=False)
class Shard:
    """The arrays of one episode of T frames and A joints.

    They include world poses (T,7) of the target, of the second body that is tracked, if any is, and
    of the first camera, whether the robot has
    touched the target by then (T,), JPEG bytes by camera, and annotations by stage.
    """

    row: Row
    time: NDArray[np.float32]
    state: NDArray[np.float32]
    action: NDArray[np.float32]
    target: NDArray[np.float32]
    goal: NDArray[np.float32] | None
    camera: NDArray[np.float32]
    touched: NDArray[np.bool_]
    images: Mapping[str, list[bytes]]
    annotations: Mapping[str, Mapping[str, NDArray[Any]]]


class Shards:
    """The Parquet export of one dataset, and the annotations that a configuration needs. Raises
    TrainError, one line."""

    def __init__(self, source: MixtureSource, config: Config) -> None:
        self.dataset, self.where, self.config = source.dataset, source.where, config
        self.annotations = NeededAnnotations(source.dataset, config)
        own = source.after_success
        self.after_success = config.data.after_success if own is None else own
        track = config.model.track
        self.goal = bool(track and track.goal)
        if not source.dataset.is_dir():
            raise TrainError(
                f"{source.dataset} does not exist: give --data the directory of a dataset"
            )
        self.root = Dataset(source.dataset).exports(EXPORT)
        try:
            table = pq.read_table(self.root / "episodes.parquet")
            self.files = sorted(self.root.glob("data-*.parquet"))
            self._groups = _groups(self.files, table["length"].to_pylist())
            told = json.loads(pq.read_schema(self.files[0]).metadata[b"domino"])
        except (OSError, IndexError, KeyError, TypeError, ValueError, pa.ArrowException) as error:
            raise TrainError(
                f"{source.dataset} has no usable Parquet export ({_short(error)}); run:"
                f" {self._export()}"
            ) from error
        names = pq.read_schema(self.files[0]).names
        self.corrected = "intervention" in names
        if self.goal and "objects_poses" not in names:
            raise TrainError(f"{self.root}: has no poses of all objects; run: {self._export()}")
        self.fps, self.names = int(told["fps"]), {k: tuple(v) for k, v in told["names"].items()}
        rows = table.to_pylist()
        self._check_export(rows)
        self.rows = self._choose_rows(rows)
        self.columns = self._columns(told["cameras"])

    def _export(self) -> str:
        labels = " --labels poses" if self.goal else ""
        return f"domino-data export {self.dataset} --format {EXPORT}{labels}"

    def _check_export(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Every accepted episode of the dataset must be in the export, made from the same
        physics."""
        dataset = Dataset(self.dataset)
        found = dataset.records(dataset.recipe()) if dataset.manifest.exists() else ()
        accepted = {
            f"episodes/{slot.path}.hdf5": record.keys.physics.digest
            for slot, record in found
            if record.accepted
        }
        exported = {row["source"]: row["physics_key"] for row in rows}
        if len(self._groups) != len(rows) or (accepted and exported != accepted):
            raise TrainError(
                f"{self.root}: is stale: it has {len(exported)} episodes, the dataset"
                f" {len(accepted)}; run: {self._export()}"
            )

    def _choose_rows(self, rows: Sequence[dict[str, Any]]) -> list[Row]:
        columns = [{name: row[name] for name in COLUMNS if name in row} for row in rows]
        expression = parse_where(self.where) if self.where else None
        wanted = [True] * len(rows) if expression is None else select_rows(columns, expression)
        chosen = [
            Row(
                row["episode_index"],
                row["source"],
                self._length(row),
                row["embodiment"],
                row["physics_id"],
                row["target"],
                tuple(row["instructions_seen"]),
                tuple(row["instructions_unseen"]),
            )
            for row, use in zip(rows, wanted, strict=True)
            if use
        ]
        if not chosen:
            raise TrainError(f"{self.dataset}: no episode fits where: {self.where!r}")
        return chosen

    def _length(self, row: Mapping[str, Any]) -> int:
        """Frames of an episode that are read."""
        after, success = self.after_success, row["t_success"]
        if after is None or success is None:
            return row["length"]
        return min(row["length"], max(0, int((success + after) * self.fps + 1e-6)) + 1)

    def _columns(self, there: Sequence[str]) -> dict[str, str]:
        """Camera -> column of its images."""
        columns = {
            camera: f"image_{EXPORTED_CAMERAS.get(camera, camera)}"
            for camera in self.config.data.cameras
        }
        for camera, column in columns.items():
            if column not in there:
                stored = {exported: name for name, exported in EXPORTED_CAMERAS.items()}
                names = [
                    stored.get(name, name) for name in (c.removeprefix("image_") for c in there)
                ]
                raise TrainError(
                    f"{self.root}: has no images of {camera}; data.cameras can be"
                    f" {', '.join(names)}"
                )
        return columns

    @cached_property
    def digest(self) -> str:
        """Hash of what is read: the tables of the export, the sizes of its files, the checksums of
        the annotations."""
        files = [[f.name, f.stat().st_size] for f in self.files]
        return digest(
            {
                "rows": [[r.source, r.length, r.physics_id] for r in self.rows],
                "files": files,
                "annotations": self.annotations.checksums([row.path for row in self.rows]),
            }
        )

    def __iter__(self) -> Iterator[Shard]:
        for row in self.rows:
            yield self.read(row)

    def read(self, row: Row) -> Shard:
        """One episode with its annotations. Raises TrainError if they were made from other
        images."""
        camera = next(iter(self.columns.values())).replace("image_", "camera_pose_", 1)
        vectors = {"state": "state", "action": "action", "target": "target_pose", "camera": camera}
        columns = ["timestamp", "contact_target", *vectors.values(), *self.columns.values()]
        columns += ["intervention"] if self.corrected else []
        columns += ["objects", "objects_poses"] if self.goal else []
        table = pa.concat_tables([_group(*place, columns) for place in self._groups[row.index]])
        images = {
            camera: [image["bytes"] for image in table[column].to_pylist()]
            for camera, column in self.columns.items()
        }
        frames = frames_digest(images[self.config.data.cameras[0]])
        annotations = {
            stage: {name: array[: row.length] for name, array in arrays.items()}
            for stage, arrays in self.annotations.read(
                row.path, row.target, table.num_rows, frames
            ).items()
        }
        images = {camera: held[: row.length] for camera, held in images.items()}
        table = table.slice(0, row.length)
        values = {
            name: np.array(table[column].to_pylist(), np.float32)
            for name, column in vectors.items()
        }
        others = (
            np.flatnonzero(~np.array(table["intervention"].to_pylist(), bool))
            if self.corrected
            else np.empty(0, np.int64)
        )
        touches = (
            np.array(table["contact_target"].to_pylist(), bool).reshape(table.num_rows, -1).any(1)
        )
        return Shard(
            row=replace(row, taught=int(others[-1]) + 1 if len(others) else 0),
            time=table["timestamp"].to_numpy().astype(np.float32),
            touched=np.logical_or.accumulate(touches),
            goal=_goal_of(table) if self.goal else None,
            images=images,
            annotations=annotations,
            **values,
        )


def _goal_of(table: pa.Table) -> NDArray[np.float32]:
    """Poses (T,7) of the second of an episode's labelled objects: what is moved, or another body
    than the target; of a task of one body, the target's."""
    poses = np.array(table["objects_poses"].to_pylist(), np.float32).reshape(len(table), -1, 7)
    return poses[:, min(1, len(table["objects"][0]) - 1)]


def _groups(files: Sequence[Path], lengths: Sequence[int]) -> list[list[tuple[Path, int]]]:
    """File and number of the row groups of each episode: consecutive ones that have its `length`
    together.

    Fewer entries than episodes where the groups do not add up.
    """
    groups = [
        (file, i, pq.read_metadata(file).row_group(i).num_rows)
        for file in files
        for i in range(_count(file))
    ]
    found: list[list[tuple[Path, int]]] = []
    for length in lengths:
        mine, rows = list[tuple[Path, int]](), 0
        while rows < length and groups:
            file, number, count = groups.pop(0)
            mine.append((file, number))
            rows += count
        if rows != length:
            return found
        found.append(mine)
    return found if not groups else []


def _count(file: Path) -> int:
    return pq.read_metadata(file).num_row_groups


def _group(file: Path, number: int, columns: Sequence[str]) -> pa.Table:
    with pq.ParquetFile(file) as source:
        return source.read_row_group(number, columns=list(columns))


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__

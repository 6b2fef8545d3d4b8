"""LeRobot v3.0 (docs/exports.md). File k of the data and of each video hold the same episodes."""

from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.export.exporter import register
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import Facts
from pipeline.export.shared.images import DEPTH
from pipeline.export.shared.statistics import image_stats, vector_stats
from pipeline.export.shared.tables import scalars

from .dataset import LerobotExporter, Writer
from .format import TEXT_FEATURES, data_table, episode_schema, image_key
from .meta import (
    Tables,
    chunk_file,
    data_schema,
    depth_schema,
    depth_table,
    read_column,
    write_meta,
)
from .options import MEGABYTE, LerobotV3Options
from .videos import Prepared, VideoFile

ROWS_PER_GROUP = 100


class V3Writer(Writer):
    def __init__(
        self, draft: ExportDraft, root: Path, first: Facts, options: LerobotV3Options
    ) -> None:
        super().__init__(draft, root, first, options)
        self.options = options
        self.data = Tables(root / "data", data_schema(self.features))
        schema = depth_schema([self.names[camera] for camera in first.cameras])
        self.depth = Tables(root / "depth", schema) if options.depth else None
        self.rows_to: Tables | None = None
        self.rows: list[dict[str, Any]] = []
        self.videos: dict[str, VideoFile] = {}

    def append(self, episode: Prepared) -> None:
        facts, length = episode.facts, episode.facts.kept
        index, columns, stats = self.begin(episode)
        if self._full(episode):
            self._roll()
        row: dict[str, Any] = {"episode_index": index, "tasks": facts.told}
        row |= {"length": length} | _below("data", self.data.place)
        row |= {"dataset_from_index": self.frames, "dataset_to_index": self.frames + length}
        self.data.write(data_table(columns, self.data.schema))
        if self.depth:
            self.depth.write(depth_table(episode.depth, self.depth.schema, index, self.frames))
        for camera, mp4 in episode.videos.items():
            key = image_key(self.names[camera])
            if key not in self.videos:
                path = self.root / "videos" / key / chunk_file(self.data.number, "mp4")
                self.videos[key] = VideoFile(path, facts.fps)
            start, end = self.videos[key].append(mp4, facts.kept)
            times = {"from_timestamp": start, "to_timestamp": end}
            row |= _below(f"videos/{key}", self.data.place | times)
        for name, entry in stats.items():
            row |= _below(f"stats/{name}", {stat: v.tolist() for stat, v in entry.items()})
        told = scalars(facts, self.draft.optional, self.draft.validation)
        row |= {f"domino.{name}": value for name, value in told.items()}
        if self.rows_to is None:
            self.rows_to = Tables(self.root / "meta" / "episodes", episode_schema(row, stats))
        self.rows.append(row)
        self.end(episode)
        if len(self.rows) == ROWS_PER_GROUP:
            self._flush()

    def _full(self, episode: Prepared) -> bool:
        most, options = self.options.video_seconds * self.first.fps, self.options
        pairs = zip(self.videos.values(), episode.videos.values(), strict=True)
        return bool(self.videos) and (
            self.data.size >= options.data_bytes
            or any(
                video.frames + episode.facts.kept > most
                or video.size + len(mp4) > options.video_bytes
                for video, mp4 in pairs
            )
        )

    def _roll(self) -> None:
        for video in self.videos.values():
            video.close()
        self.videos = {}
        self.data.roll()
        if self.depth:
            self.depth.roll()

    def _flush(self) -> None:
        if self.rows and self.rows_to is not None:
            if self.rows_to.size >= self.options.data_bytes:
                self.rows_to.roll()
            place = _below("meta/episodes", self.rows_to.place)
            rows, schema = [row | place for row in self.rows], self.rows_to.schema
            self.rows_to.write(pa.Table.from_pylist(rows, schema=schema))
            self.rows.clear()

    def close(self) -> None:
        with ExitStack() as closed:  # all of them, even where the disk refuses one
            closed.callback(super().close)
            for video in self.videos.values():
                closed.callback(video.close)
            for tables in (self.rows_to, self.depth, self.data):
                if tables:
                    closed.callback(tables.close)
            closed.callback(self._flush)

    def finish(self) -> dict[str, Any]:
        summary, options = super().finish(), self.options
        stats = {
            name: vector_stats(read_column(self.root / "data", name))
            for name in self.data.schema.names
            if name not in TEXT_FEATURES
        }
        stats |= {key: image_stats(counts, self.sampled) for key, counts in self.colors.items()}
        info = {
            "codebase_version": Lerobot.version,
            "fps": self.first.fps,
            "features": self.features,
            "total_episodes": summary["episodes"],
            "total_frames": summary["frames"],
            "total_tasks": summary["tasks"],
            "data_files_size_in_mb": max(1, options.data_bytes // MEGABYTE),
            "video_files_size_in_mb": max(1, options.video_bytes // MEGABYTE),
            "robot_type": self.first.spec.embodiment,
            "splits": self.splits,
        }
        write_meta(self.root, info, list(self.tasks), stats)
        return summary


def _below(prefix: str, values: dict[str, Any]) -> dict[str, Any]:
    return {f"{prefix}/{name}": value for name, value in values.items()}


@register
class Lerobot(LerobotExporter[LerobotV3Options]):
    name = "lerobot"
    options = LerobotV3Options
    version = "v3.0"
    writer = V3Writer

    def sensors(self, options: LerobotV3Options) -> Collection[str]:
        return (DEPTH,) if options.depth else ()

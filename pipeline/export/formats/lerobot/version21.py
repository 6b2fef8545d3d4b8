"""LeRobot v2.1, which openpi and StarVLA read, and present lerobot does not."""

import json
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.export.exporter import register
from pipeline.export.shared.draft import ExportDraft
from pipeline.export.shared.episodes import Facts
from pipeline.export.shared.record import write_json

from .dataset import LerobotExporter, Writer
from .format import data_table, image_key
from .meta import FILES_PER_CHUNK, data_schema, read_column
from .options import LerobotOptions
from .videos import Prepared, VideoFile

DATA_PATH = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO_PATH = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
GROOT_QUANTILES = {"q01": 0.01, "q99": 0.99}
STATS = ("min", "max", "mean", "std", "count")


class V21Writer(Writer):
    def __init__(
        self, draft: ExportDraft, root: Path, first: Facts, options: LerobotOptions
    ) -> None:
        super().__init__(draft, root, first, options)
        self.schema = readable_by_old(data_schema(self.features))
        self.rows: list[dict[str, Any]] = []
        self.stats: list[dict[str, Any]] = []

    def _place(self, template: str, index: int, key: str = "") -> Path:
        chunk = index // FILES_PER_CHUNK
        name = template.format(episode_chunk=chunk, episode_index=index, video_key=key)
        return self.root / name

    def append(self, episode: Prepared) -> None:
        facts = episode.facts
        index, columns, stats = self.begin(episode)
        path = self._place(DATA_PATH, index)
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(data_table(columns, self.schema), path)
        for camera, mp4 in episode.videos.items():
            place = self._place(VIDEO_PATH, index, image_key(self.names[camera]))
            with closing(VideoFile(place, facts.fps)) as video:
                video.append(mp4, facts.kept)
        row = {"episode_index": index, "tasks": facts.told, "length": facts.kept}
        self.rows.append(row)
        plain = {
            key: {stat: entry[stat].tolist() for stat in STATS} for key, entry in stats.items()
        }
        self.stats.append({"episode_index": index, "stats": plain})
        self.end(episode)

    def finish(self) -> dict[str, Any]:
        summary = super().finish()
        meta, episodes = self.root / "meta", summary["episodes"]
        info = {
            "codebase_version": LerobotV21.version,
            "robot_type": self.first.spec.embodiment,
            "total_episodes": episodes,
            "total_frames": summary["frames"],
            "total_tasks": summary["tasks"],
            "total_videos": episodes * len(self.names),
            "total_chunks": -(-episodes // FILES_PER_CHUNK),
            "chunks_size": FILES_PER_CHUNK,
            "fps": self.first.fps,
            "splits": self.splits,
            "data_path": DATA_PATH,
            "video_path": VIDEO_PATH,
            "features": self.features,
        }
        (meta / "info.json").write_text(json.dumps(info, indent=4) + "\n")
        tasks = ({"task_index": i, "task": task} for task, i in self.tasks.items())
        _write_lines(meta / "tasks.jsonl", tasks)
        _write_lines(meta / "episodes.jsonl", self.rows)
        _write_lines(meta / "episodes_stats.jsonl", self.stats)
        write_json(meta / "stats.json", groot_stats(self.root, self.features))
        return summary


def readable_by_old(schema: pa.Schema) -> pa.Schema:
    """Old datasets called lists of fixed length Sequence."""
    key, metadata = b"huggingface", dict(schema.metadata)
    metadata[key] = metadata[key].replace(b'"_type": "List"', b'"_type": "Sequence"')
    return schema.with_metadata(metadata)


def groot_stats(
    root: Path, features: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, list[float]]]:
    """Statistics as GR00T makes meta/stats.json; quantiles are interpolated linearly."""
    stats = {}
    for name in (key for key, value in features.items() if value["dtype"].startswith("float")):
        column = read_column(root / "data", name).astype(np.float64)
        values = column.reshape(len(column), -1)
        entry = {stat: getattr(values, stat)(0) for stat in ("mean", "std", "min", "max")}
        entry |= {key: np.quantile(values, q, axis=0) for key, q in GROOT_QUANTILES.items()}
        stats[name] = {key: value.tolist() for key, value in entry.items()}
    return stats


def _write_lines(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    path.write_text("".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows))


@register
class LerobotV21(LerobotExporter[LerobotOptions]):
    name = "lerobot-v2.1"
    options = LerobotOptions
    version = "v2.1"
    writer = V21Writer

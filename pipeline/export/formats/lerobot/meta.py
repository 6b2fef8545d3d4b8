"""Schema, info.json, tasks and statistics, with the bytes that lerobot 0.6.1 writes, and its
language columns (lerobot/datasets/language.py).

Every frame's `language_persistent` has all rows of the episode, with the time from which each is
active: `subtask`, `plan`, `motion` (m, world). `language_events` has a `trace` every third
frame: the target's path in the next second, in pixels."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.export.shared.derived import trace_of
from pipeline.export.shared.episodes import Facts
from pipeline.export.shared.script import Script, script_of, spoken_names
from pipeline.export.shared.statistics import Stats
from pipeline.motion.recorded import track

from .format import CLOCK_FEATURES, image_key
from .tables import FILES_PER_CHUNK

PERSISTENT, EVENTS = "language_persistent", "language_events"
TRACE_EVERY = 3  # frames between two points of a trace


def _persistent_rows(facts: Facts, script: Script) -> list[dict[str, Any]]:
    """By time, at every frame where the subtask changes."""
    starts, rows = script.changes(), list[dict[str, Any]]()
    for k, t in enumerate(starts):
        left = [script.subtask[s] for s in starts[k:]]
        texts = {
            "motion": _motion_between(facts, t, [*starts, len(facts) - 1][k + 1]),
            "plan": "\n".join(f"{n}. {text}" for n, text in enumerate(left, 1)),
            "subtask": script.subtask[t],
        }
        rows += [
            {"role": "assistant", "content": text, "style": style, "timestamp": t / facts.fps}
            for style, text in texts.items()
        ]
    return rows


def _motion_between(facts: Facts, start: int, end: int) -> str:
    log, parts = facts.log, list[str]()
    for index, side in enumerate(log.sides):
        x, y, z = np.round(log.tcp[end, index, :3] - log.tcp[start, index, :3], 3) + 0.0
        gripper = log.state[[start, end], log.vector_names.index(f"{side}_gripper")]
        jaws = f"{gripper[0]:.2f} to {gripper[1]:.2f}"
        parts.append(f"{side} hand {x:+.3f} {y:+.3f} {z:+.3f} m, gripper {jaws}")
    return "; ".join(parts)


def _event_rows(facts: Facts, keys: Mapping[str, str]) -> list[list[dict[str, Any]]]:
    rows: list[list[dict[str, Any]]] = [[] for _ in range(len(facts))]
    label = spoken_names(facts)[facts.meta.target].removeprefix("the ")
    for camera in sorted(facts.cameras, key=lambda name: keys[name]):
        kind = facts.meta.drawing.cameras[camera].camera(camera).type
        now = track(kind, facts.camera_poses[camera], facts.target[:, :3])
        later = trace_of(facts, camera)[:, TRACE_EVERY - 1 :: TRACE_EVERY]
        places = np.round(np.concatenate([now[:, None, :2], later[:, :, :2]], axis=1), 1).tolist()
        before = (later[:, :, 2] > 0).tolist()
        for t in np.flatnonzero(now[:, 3]):
            shown = zip(places[t], (True, *before[t]), strict=True)
            points = [place for place, is_shown in shown if is_shown]
            content = json.dumps({"label": label, "point_format": "xy", "points": points})
            row = {"role": "assistant", "content": content, "style": "trace"}
            rows[t].append(row | {"camera": keys[camera]})
    return rows


def _list_column(
    rows: Sequence[Mapping[str, Any]], offsets: NDArray[np.int32], kind: pa.ListType
) -> pa.ListArray:
    """Rows as a column of lists that end at `offsets`."""
    fields, inner = list[pa.Array](), list(kind.value_type)
    for field in inner:
        if field.name == "tool_calls":  # Arrow makes no lists of its JSON type from Python values
            fields.append(pa.nulls(len(rows), field.type))
        else:
            fields.append(pa.array([row.get(field.name) for row in rows], field.type))
    values = pa.StructArray.from_arrays(fields, fields=inner)
    return pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), values, type=kind)


def with_language(features: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    more = {
        name: {"dtype": "language", "shape": [1], "names": None} for name in (PERSISTENT, EVENTS)
    }
    clock = {name: features[name] for name in CLOCK_FEATURES}
    return {k: v for k, v in features.items() if k not in clock} | more | clock


def language_columns(
    facts: Facts, names: Mapping[str, str], schema: pa.Schema
) -> dict[str, pa.ListArray]:
    keys = {camera: image_key(names[camera]) for camera in facts.cameras}
    every = _persistent_rows(facts, script_of(facts))
    lasting = [row for row in every if row["timestamp"] * facts.fps < facts.kept]
    events = _event_rows(facts, keys)[: facts.kept]
    once = _list_column(
        lasting, np.array([0, len(lasting)], np.int32), schema.field(PERSISTENT).type
    )
    ends = np.cumsum([0, *map(len, events)]).astype(np.int32)
    return {
        PERSISTENT: once.take(pa.array(np.zeros(facts.kept, np.int64))),
        EVENTS: _list_column(
            [row for each in events for row in each], ends, schema.field(EVENTS).type
        ),
    }


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
    """Schema of the data files, with Hugging Face features in the metadata."""
    stored = {name: feature for name, feature in features.items() if feature["dtype"] != "video"}
    kinds = {name: _column(name, feature) for name, feature in stored.items()}
    described = {"info": {"features": {name: words for name, (_, words) in kinds.items()}}}
    return pa.schema(
        [(name, kind) for name, (kind, _) in kinds.items()],
        metadata={"huggingface": json.dumps(described)},
    )


def _column(name: str, feature: Mapping[str, Any]) -> tuple[pa.DataType, dict[str, Any]]:
    if name in (PERSISTENT, EVENTS):
        return _language(with_time=name == PERSISTENT)
    kind, (length,) = feature["dtype"], feature["shape"]
    arrow, value = pa.type_for_alias(kind), {"dtype": kind, "_type": "Value"}
    if length == 1:
        return arrow, value
    return pa.list_(arrow, length), {"feature": value, "length": length, "_type": "List"}


def _language(*, with_time: bool) -> tuple[pa.DataType, dict[str, Any]]:
    kinds = {"role": "string", "content": "string", "style": "string"}
    kinds |= {"timestamp": "float32"} if with_time else {}
    kinds |= {"camera": "string"}
    arrow = {name: pa.type_for_alias(kind) for name, kind in kinds.items()}
    words: dict[str, Any] = {k: {"dtype": kind, "_type": "Value"} for k, kind in kinds.items()}
    arrow["tool_calls"] = pa.list_(pa.json_())
    words["tool_calls"] = {"feature": {"_type": "Json"}, "_type": "List"}
    return pa.list_(pa.struct(list(arrow.items()))), {"feature": words, "_type": "List"}


def write_meta(
    root: Path, info: Mapping[str, Any], tasks: Sequence[str], stats: Mapping[str, Stats]
) -> None:
    """`info` are the fields not in DEFAULTS."""
    meta = root / "meta"
    meta.mkdir(parents=True, exist_ok=True)
    _write_json(meta / "info.json", {name: (DEFAULTS | dict(info))[name] for name in ORDER})
    pq.write_table(_tasks_table(tasks), meta / "tasks.parquet")
    plain = {key: {stat: v.tolist() for stat, v in entry.items()} for key, entry in stats.items()}
    _write_json(meta / "stats.json", plain)


def _tasks_table(tasks: Sequence[str]) -> pa.Table:
    """pandas finds the column `task` as its index."""

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

"""What a robot does not know is outside of `observation.`, which policies take for an input."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.actions import JOINTS, Representation
from pipeline.data.cameras import intrinsics
from pipeline.data.names import SIDES
from pipeline.export.shared.derived import (
    contact_flags,
    event_columns,
    label_names,
    label_values,
    trace_of,
)
from pipeline.export.shared.episodes import Facts
from pipeline.export.shared.script import script_of
from pipeline.export.shared.statistics import Stats
from pipeline.export.shared.tables import SCALAR_TYPES
from pipeline.export.shared.video import Codec
from pipeline.motion.recorded import path_ahead

POSE_NAMES = ["x", "y", "z", "qw", "qx", "qy", "qz"]
EVENT = "event.kind"
TEXT_FEATURES = ("subtask", "skill", "stage", EVENT)
"""One text a frame: script.Script has the first three, EVENT is there if events are."""

CLOCK_FEATURES = {
    "timestamp": "float32",
    **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64"),
}


def image_key(name: str) -> str:
    """ "cam_high" -> "observation.images.cam_high"."""
    return f"observation.images.{name}"


def features_of(facts: Facts, codec: Codec, names: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Features in the order of the columns; `names` are the exported cameras."""
    features: dict[str, dict[str, Any]] = {
        name: {"dtype": "float32", "shape": [len(parts)], "names": parts}
        for name, (parts, _) in _vectors(facts, names).items()
    }
    for camera in facts.cameras:
        shape = {"shape": [*facts.size, 3], "names": ["height", "width", "channels"]}
        video = {"dtype": "video", **shape, "info": _video_info(facts, codec)}
        features[image_key(names[camera])] = video
    for name in TEXT_FEATURES:
        if facts.eventful or name != EVENT:
            features[name] = {"dtype": "string", "shape": [1], "names": [name]}
    return features | {
        name: {"dtype": kind, "shape": [1], "names": None} for name, kind in CLOCK_FEATURES.items()
    }


def _vectors(facts: Facts, names: Mapping[str, str]) -> dict[str, tuple[list[str], NDArray[Any]]]:
    """Names of the numbers, and values (T,d)."""
    log, length, later = facts.log, len(facts), range(1, facts.fps + 1)
    meta, actions = facts.meta, facts.action_names
    vectors: dict[str, tuple[list[str], NDArray[Any]]] = {
        "observation.state": (list(log.vector_names), log.state),
        "action": (actions, facts.action),
    }
    for more in facts.more:
        values = facts.written(log.action, more)
        vectors[f"action.{more.actions}"] = facts.names_in(more), values
    vectors["target.pose"] = POSE_NAMES, facts.target
    vectors["target.velocity"] = ["vx", "vy", "vz"], log.target_velocity
    if log.target_angular_velocity is not None:
        vectors["target.angular_velocity"] = ["wx", "wy", "wz"], log.target_angular_velocity
    tools = [f"{side}_{part}" for side in log.sides for part in POSE_NAMES]
    vectors["ee.pose"] = tools, log.tcp.reshape(length, -1)
    for camera in facts.cameras:
        vectors[f"camera.{names[camera]}.pose"] = POSE_NAMES, facts.camera_poses[camera]
    vectors["contact.target"] = list(SIDES), contact_flags(facts, meta.target)
    vectors["contact.manipulated"] = list(SIDES), contact_flags(facts, meta.manipulated)
    path = path_ahead(facts.target[:, :3], facts.fps).reshape(length, -1)
    vectors["target.path"] = [f"{axis}{k}" for k in later for axis in ("x", "y", "z")], path
    for camera in facts.cameras:
        parts = [f"{part}{k}" for k in later for part in ("u", "v", "depth")]
        vectors[f"trace.{names[camera]}"] = parts, trace_of(facts, camera).reshape(length, -1)
    if log.intervention is not None and log.expert_action is not None:
        vectors["intervention"] = ["expert"], log.intervention
        vectors["expert_action"] = actions, facts.written(log.expert_action, facts.representation)
    if facts.eventful:
        vectors["event.active"] = ["any"], event_columns(facts)[1]
    values = label_values(facts, facts.labels, ".")
    parts = label_names(facts.labels, ".")
    return vectors | {name: (parts[name], values[name]) for name in parts}


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
        "video.crf": codec.quality,
        "video.preset": int(preset) if preset.isdigit() else preset,
        "video.fast_decode": 0,
        "video.video_backend": "pyav",
        "video.extra_options": {},
        "is_depth_map": False,
    }


def data_table(columns: Mapping[str, NDArray[Any] | pa.Array], schema: pa.Schema) -> pa.Table:
    arrays = []
    for field in schema:
        values = columns[field.name]
        if not isinstance(values, pa.Array):
            wide, values = values.ndim > 1, pa.array(values.ravel())
            if wide:
                values = pa.FixedSizeListArray.from_arrays(values, type=field.type)
        arrays.append(values)
    return pa.Table.from_arrays(arrays, schema=schema)


def data_columns(
    facts: Facts, names: Mapping[str, str], index: int, start: int, tasks: Mapping[str, int]
) -> dict[str, NDArray[Any]]:
    """Columns (T,) or (T,d) of episode `index`, whose first row is `start`."""
    length, script = len(facts), script_of(facts)
    columns: dict[str, NDArray[Any]] = {
        name: np.ascontiguousarray(values, np.float32)
        for name, (_, values) in _vectors(facts, names).items()
    }
    for name in TEXT_FEATURES[:3]:
        columns[name] = np.array(getattr(script, name), object)
    if facts.eventful:
        columns[EVENT] = np.array(event_columns(facts)[0], object)
    columns |= {
        "timestamp": (np.arange(length) / facts.fps).astype(np.float32),
        "frame_index": np.arange(length),
        "episode_index": np.full(length, index),
        "index": np.arange(start, start + length),
        "task_index": np.array([tasks.get(text, 0) for text in facts.spoken]),
    }
    return {name: values[: facts.kept] for name, values in columns.items()}


def episode_schema(row: dict[str, Any], stats: dict[str, Stats]) -> pa.Schema:
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
    places = ("meta/episodes/chunk_index", "meta/episodes/file_index")
    return pa.schema(types | dict.fromkeys(places, pa.int64()))


def modality(facts: Facts, names: Mapping[str, str]) -> dict[str, Any]:
    """The content of meta/modality.json as GR00T and StarVLA read it."""
    return {
        "state": _slices(facts.log.vector_names, "observation.state", JOINTS),
        "action": _slices(facts.log.vector_names, "action", facts.representation),
        "video": {name: {"original_key": image_key(name)} for name in names.values()},
        "annotation": {"human.action.task_description": {"original_key": "task_index"}},
    }


def _slices(
    vector_names: Sequence[str], key: str, representation: Representation
) -> dict[str, dict[str, Any]]:
    """GR00T's 6-D rotations are rows, ours columns: no type names them."""
    parts: dict[str, dict[str, Any]] = {}
    for name, at in representation.slices(vector_names).items():
        kind = name.partition("_")[2]
        parts[name] = part = {"start": at.start, "end": at.stop}
        if representation != JOINTS:
            part["absolute"] = kind == "gripper" or representation.reference == "absolute"
        if kind == "rotation" and representation.rotation != "6d":
            part["rotation_type"] = representation.rotation.replace("-", "_")
        part["original_key"] = key
    return parts


def described_cameras(facts: Facts, names: Mapping[str, str]) -> dict[str, Any]:
    described = {}
    for camera, info in facts.meta.drawing.cameras.items():
        if camera in facts.cameras:
            matrix = intrinsics(info.camera(camera).type).tolist()
            described[names[camera]] = {"intrinsic_cv": matrix, "link": info.link}
    return described

"""Features and columns of a LeRobot dataset, made whole episodes at a time. What a robot does not
know, such as the target's pose, is outside of `observation.`, which policies take for an input."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.actions import JOINTS, Representation
from pipeline.data.cameras import intrinsics
from pipeline.data.names import SIDES
from pipeline.export.shared.derived import contact_flags, event_columns, trace_of
from pipeline.export.shared.episodes import FAILURES, PAD, Facts
from pipeline.export.shared.labels import label_names, label_values
from pipeline.export.shared.provenance import SCALAR_TYPES
from pipeline.export.shared.script import script_of
from pipeline.export.shared.statistics import Stats, vector_stats
from pipeline.export.shared.video import Codec
from pipeline.motion.paths import path_ahead

POSE_NAMES = ["x", "y", "z", "qw", "qx", "qy", "qz"]
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
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
    """Features in the order of the columns, the clock last; `names` are the exported cameras."""
    features: dict[str, dict[str, Any]] = {
        name: {"dtype": "float32", "shape": [len(parts)], "names": parts}
        for name, parts in vector_names(facts, names).items()
    }
    for camera in facts.cameras:
        shape = {"shape": [*facts.size, 3], "names": ["height", "width", "channels"]}
        video = {"dtype": "video", **shape, "info": _video_info(facts, codec)}
        features[image_key(names[camera])] = video
    features |= {
        name: {"dtype": "string", "shape": [1], "names": [name]}
        for name in TEXT_FEATURES
        if facts.eventful or name != EVENT
    }
    return features | {
        name: {"dtype": kind, "shape": [1], "names": None} for name, kind in CLOCK_FEATURES.items()
    }


def before_clock(
    features: Mapping[str, dict[str, Any]], more: Mapping[str, dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    clock = {name: features[name] for name in CLOCK_FEATURES}
    return {k: v for k, v in features.items() if k not in clock} | dict(more) | clock


def widen(facts: Facts, width: int) -> Facts:
    """The same with vectors of at least `width`: zeros in the place of a missing arm, else at the
    end."""
    log = facts.log
    if (more := width - len(log.vector_names)) <= 0:
        return facts
    before, after = (more, 0) if log.sides == SIDES[1:] else (0, more)

    def filled(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.pad(values, ((0, 0), (before, after)))

    pads = tuple(f"{PAD}{i}" for i in range(more))
    names = (*pads[:before], *log.vector_names, *pads[before:])
    expert = None if log.expert_action is None else filled(log.expert_action)
    wide = replace(log, vector_names=names, state=filled(log.state), action=filled(log.action))
    return replace(facts, log=replace(wide, expert_action=expert))


def vector_names(facts: Facts, names: Mapping[str, str]) -> dict[str, list[str]]:
    """Names of the numbers of every vector; paths and traces reach one second ahead."""
    joints, actions = list(facts.log.vector_names), facts.action_names
    later = range(1, facts.fps + 1)
    return {
        "observation.state": joints,
        "action": actions,
        **{f"action.{more.actions}": facts.names_in(more) for more in facts.more},
        "target.pose": POSE_NAMES,
        "target.velocity": ["vx", "vy", "vz"],
        **({"target.angular_velocity": ["wx", "wy", "wz"]} if facts.spins else {}),
        "ee.pose": [f"{side}_{part}" for side in facts.log.sides for part in POSE_NAMES],
        **{f"camera.{names[camera]}.pose": POSE_NAMES for camera in facts.cameras},
        "contact.target": list(SIDES),
        "contact.manipulated": list(SIDES),
        "target.path": [f"{axis}{k}" for k in later for axis in ("x", "y", "z")],
        **{
            f"trace.{names[camera]}": [f"{part}{k}" for k in later for part in ("u", "v", "depth")]
            for camera in facts.cameras
        },
        **({"intervention": ["expert"], "expert_action": actions} if facts.corrected else {}),
        **({"event.active": ["any"]} if facts.eventful else {}),
        **label_names(facts.labels, "."),
    }


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
    """Rows of a data file from columns (T,) or (T,d), or Arrow arrays."""
    arrays = []
    for field in schema:
        values = columns[field.name]
        if isinstance(values, pa.Array):
            arrays.append(values)
            continue
        flat = pa.array(values.ravel())
        arrays.append(
            flat if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, type=field.type)
        )
    return pa.Table.from_arrays(arrays, schema=schema)


def data_columns(
    facts: Facts, names: Mapping[str, str], index: int, start: int, task: int
) -> dict[str, NDArray[Any]]:
    """Columns (T,) or (T,d) of episode `index`, whose first row is `start`."""
    length, log = len(facts), facts.log
    vectors = {
        "observation.state": log.state,
        "action": facts.action,
        **{f"action.{more.actions}": facts.written(log.action, more) for more in facts.more},
        "target.pose": facts.target,
        "target.velocity": log.target_velocity,
        **(
            {"target.angular_velocity": np.array(log.target_angular_velocity)}
            if facts.spins
            else {}
        ),
        "ee.pose": log.tcp.reshape(length, -1),
        **{f"camera.{names[camera]}.pose": facts.camera_poses[camera] for camera in facts.cameras},
        "contact.target": contact_flags(facts, facts.meta.target),
        "contact.manipulated": contact_flags(facts, facts.meta.manipulated),
        "target.path": path_ahead(facts.target[:, :3], facts.fps).reshape(length, -1),
        **{
            f"trace.{names[camera]}": trace_of(facts, camera).reshape(length, -1)
            for camera in facts.cameras
        },
    }
    if facts.corrected:
        vectors |= {
            "intervention": np.array(log.intervention),
            "expert_action": facts.written(np.array(log.expert_action), facts.representation),
        }
    vectors |= label_values(facts, facts.labels, ".")
    script = script_of(facts)
    texts = {
        name: np.array(getattr(script, name), object) for name in TEXT_FEATURES if name != EVENT
    }
    if facts.eventful:
        kinds, vectors["event.active"] = event_columns(facts)
        texts[EVENT] = np.array(kinds, object)
    numbers = {name: np.ascontiguousarray(values, np.float32) for name, values in vectors.items()}
    clock = {
        "timestamp": (np.arange(length) / facts.fps).astype(np.float32),
        "frame_index": np.arange(length),
        "episode_index": np.full(length, index),
        "index": np.arange(start, start + length),
        "task_index": np.full(length, task),
    }
    return {name: values[: facts.kept] for name, values in (numbers | texts | clock).items()}


def column_stats(columns: Mapping[str, NDArray[Any]]) -> dict[str, Stats]:
    return {
        name: vector_stats(values) for name, values in columns.items() if name not in TEXT_FEATURES
    }


def episode_schema(row: dict[str, Any], stats: dict[str, Stats]) -> pa.Schema:
    """Schema of meta/episodes from a row and its statistics."""
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
    """meta/modality.json as GR00T and StarVLA read it."""
    action = facts.representation
    return {
        "state": _slices(facts.log.vector_names, "observation.state", JOINTS),
        "action": _slices(facts.action_names, "action", action),
        "video": {name: {"original_key": image_key(name)} for name in names.values()},
        "annotation": {"human.action.task_description": {"original_key": "task_index"}},
    }


def _slices(
    names: Sequence[str], key: str, representation: Representation
) -> dict[str, dict[str, Any]]:
    """Slices by side and part. GR00T's 6-D rotations are rows of the matrix, ours columns: no type
    names them."""
    parts: dict[str, dict[str, Any]] = {}
    for i, name in enumerate(names):
        if name.startswith(PAD):
            continue
        side, _, number = name.partition("_")
        kind = "gripper" if number == "gripper" else "joints"
        if representation.poses and kind == "joints":
            kind = "position" if number in ("x", "y", "z") else "rotation"
        part = parts.setdefault(f"{side}_{kind}", {"start": i, "end": i})
        part["end"] = i + 1
        if representation != JOINTS:
            part["absolute"] = kind == "gripper" or representation.reference == "absolute"
        if kind == "rotation" and representation.rotation != "6d":
            part["rotation_type"] = representation.rotation.replace("-", "_")
    return {name: {**part, "original_key": key} for name, part in parts.items()}


def described_cameras(facts: Facts, names: Mapping[str, str]) -> dict[str, Any]:
    """Each camera's pinhole matrix (pixels) and the link that carries it."""
    known = facts.meta.drawing.cameras
    return {
        names[camera]: {
            "intrinsic_cv": intrinsics(known[camera].camera(camera).type).tolist(),
            "link": known[camera].link,
        }
        for camera in facts.cameras
        if camera in known
    }


def split_of(first: Facts) -> str:
    """The dataset's split by its first episode."""
    return FAILURES if first.meta.failure else "train"


def description(summary: dict[str, Any], first: Facts) -> str:
    """A paragraph on the content of a dataset, for its card."""
    action = "the joint target commanded for the interval after it"
    if first.representation != JOINTS:
        action = first.representation.describe()
    return (
        f"{summary['episodes']} simulated episodes ({summary['frames']} frames at {summary['fps']}"
        f" Hz) of {first.spec.embodiment} handling moving objects. `observation.state` is measured"
        f" at the frame, `action` is {action}. Poses"
        " are x y z qw qx qy qz in the world frame (m). `meta/domino_episodes.parquet` has the"
        " task, level, speed and motion of every episode."
    )

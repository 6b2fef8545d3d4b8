"""Schema and episode tables of the Parquet format."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.actions import JOINTS
from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import SIDES
from pipeline.export.shared.annotations import Joined, annotation_columns
from pipeline.export.shared.derived import (
    contact_flags,
    event_columns,
    interception,
    label_names,
    label_values,
    labelled,
    trace_of,
)
from pipeline.export.shared.episodes import CLOCK_TOLERANCE, Facts
from pipeline.export.shared.images import IMAGE, IMAGES, POINTCLOUD, coded_images, image_column
from pipeline.export.shared.script import script_of
from pipeline.motion.recorded import path_ahead, track

VECTORS = ("state", "action", "target_pose", "target_velocity")
TOOLS = {side: f"tcp_{side}" for side in SIDES}
FLAGS = ("contact_target", "contact_manipulated", "held")
TEXTS = ("subtask", "skill", "stage")
CONSTANTS = {
    **{"task": pa.string(), "embodiment": pa.string(), "level": pa.int64(), "alpha": pa.float64()},
    **{"domain": pa.string(), "slot": pa.int64(), "seed": pa.int64()},
    **{"physics_id": pa.string(), "variant": pa.int64(), "instruction": pa.string()},
}
FLOATS, TEXT, NUMBER, FLAG = pa.list_(pa.float32()), pa.string(), pa.int64(), pa.bool_()


@dataclass(frozen=True)
class Plan:
    """What the columns follow from; names of joints and actions are by robot."""

    first: Facts
    cameras: Mapping[str, str]
    names: Mapping[str, list[str]]
    actions: Mapping[str, list[str]]
    sensors: Collection[str]
    joined: Sequence[Joined]
    labels: Sequence[str]

    @property
    def fps(self) -> int:
        return self.first.fps

    @property
    def images(self) -> dict[str, str]:
        return {camera: f"image_{name}" for camera, name in self.cameras.items()}

    @property
    def sensor_images(self) -> dict[tuple[str, str], str]:
        """Columns by camera and sensor: ("left_camera", "depth") -> "depth_cam_left_wrist"."""
        return {
            (camera, sensor): f"{sensor}_{name}"
            for camera, name in self.cameras.items()
            for sensor in IMAGES
            if sensor in self.sensors
        }

    def schema(self) -> pa.Schema:
        first = self.first
        columns: dict[str, pa.DataType] = dict.fromkeys(("episode_index", "frame_index"), NUMBER)
        columns |= {"timestamp": pa.float64(), **CONSTANTS, **dict.fromkeys(TEXTS, TEXT)}
        columns |= dict.fromkeys((*VECTORS, *TOOLS.values(), "target_path"), FLOATS)
        columns |= {"target_angular_velocity": FLOATS} if first.spins else {}
        columns |= {"events": pa.list_(TEXT), "event_times": pa.list_(pa.float64())}
        columns |= {"is_first": FLAG, "is_last": FLAG}
        if self.labels:
            columns |= {
                "objects": pa.list_(TEXT),
                **dict.fromkeys(label_names(self.labels), FLOATS),
            }
        columns |= {"intervention": FLAG, "expert_action": FLOATS} if first.corrected else {}
        if first.eventful:
            columns |= {"event_kind": TEXT, "event_active": FLAG, "pair": TEXT}
        columns |= {"arm": TEXT} if first.paired else {}
        columns |= {"sim_step": NUMBER, **dict.fromkeys(FLAGS, pa.list_(FLAG))}
        for name in self.cameras.values():
            kinds = ("camera_pose", "target_track", "trace")
            columns |= {f"{kind}_{name}": FLOATS for kind in kinds}
        columns |= dict.fromkeys((*self.images.values(), *self.sensor_images.values()), IMAGE)
        columns |= {POINTCLOUD: FLOATS} if POINTCLOUD in self.sensors else {}
        for one in self.joined:
            columns |= one.columns
        schema = pa.schema(list(columns.items()))
        described: dict[str, Any] = {
            "fps": self.fps,
            "cameras": list(self.images.values()),
            "names": dict(self.names),
            "annotations": {
                j.directory: {
                    "stage": j.stage,
                    "columns": list(j.columns),
                    "parameters": dict(j.parameters),
                }
                for j in self.joined
            },
        }
        if first.representation != JOINTS:
            described["action_names"] = dict(self.actions)
        if self.labels:
            described["label_names"] = label_names(self.labels)
        features = {"info": {"features": {field.name: _feature(field.type) for field in schema}}}
        domino = json.dumps(described, sort_keys=True)
        return schema.with_metadata({"huggingface": json.dumps(features), "domino": domino})


def _feature(kind: pa.DataType) -> dict[str, Any]:
    if kind == IMAGE:
        return {"_type": "Image"}
    if isinstance(kind, pa.ListType):
        return {"feature": _feature(kind.value_type), "_type": "List"}
    if isinstance(kind, pa.StructType):
        return {field.name: _feature(field.type) for field in kind}
    dtype = {"double": "float64", "float": "float32"}.get(str(kind), str(kind))
    return {"dtype": dtype, "_type": "Value"}


def episode_table(
    index: int, facts: Facts, file: EpisodeFile, plan: Plan, dataset: Path
) -> pa.Table:
    schema = plan.schema()
    columns = dict(_columns(index, facts, plan)) | dict(_images(file, plan))
    columns |= annotation_columns(plan.joined, dataset, file, facts)
    return pa.table({name: columns[name] for name in schema.names}, schema=schema)


def _columns(index: int, facts: Facts, plan: Plan) -> Iterator[tuple[str, Any]]:
    frames, log, derived = len(facts), facts.log, interception(facts)
    spec, meta, target = facts.spec, facts.meta, facts.target[:, :3]
    of_meta = {"physics_id": meta.physics_id, "variant": meta.variant}
    constants = {name: [value] * frames for name, value in (vars(spec) | of_meta).items()}
    constants["instruction"] = facts.spoken
    for name, kind in CONSTANTS.items():
        yield name, pa.array(constants[name], kind)
    numbers = np.arange(frames)
    yield from {"episode_index": np.full(frames, index), "frame_index": numbers}.items()
    yield from {"is_first": numbers == 0, "is_last": numbers == frames - 1}.items()
    yield "timestamp", log.times - log.times[0]
    values = (log.state, facts.action, facts.target, log.target_velocity)
    yield from ((name, _lists(value)) for name, value in zip(VECTORS, values, strict=True))
    if log.target_angular_velocity is not None:
        yield "target_angular_velocity", _lists(log.target_angular_velocity)
    tools = dict(zip(log.sides, log.tcp.swapaxes(0, 1), strict=True))
    for side, name in TOOLS.items():
        yield name, _lists(tools[side]) if side in tools else pa.nulls(frames, FLOATS)
    yield from vars(script_of(facts)).items()
    yield "target_path", _lists(path_ahead(target, facts.fps))
    names: list[list[str]] = [[] for _ in range(frames)]
    times: list[list[float]] = [[] for _ in range(frames)]
    for frame, name, time in event_frames(facts):
        names[frame].append(name)
        times[frame].append(time - float(log.times[0]))
    yield from {"events": names, "event_times": times}.items()
    if plan.labels:
        yield "objects", [labelled(facts)] * frames
        yield from ((n, _lists(v)) for n, v in label_values(facts, plan.labels).items())
    if log.intervention is not None and log.expert_action is not None:
        yield "intervention", log.intervention
        yield "expert_action", _lists(facts.written(log.expert_action, facts.representation))
    kinds, active = event_columns(facts)
    yield from {"event_kind": kinds, "event_active": active > 0}.items()
    yield from {"pair": [spec.pair] * frames, "arm": [spec.arm] * frames}.items()
    yield "sim_step", derived.steps
    touched = (contact_flags(facts, body) for body in (meta.target, meta.manipulated))
    for name, value in zip(FLAGS, (*touched, derived.held), strict=True):
        yield name, pa.array(list(value.astype(bool)), pa.list_(FLAG))
    for camera, name in plan.cameras.items():
        poses = facts.camera_poses[camera]
        yield f"camera_pose_{name}", _lists(poses)
        seen = track(meta.drawing.cameras[camera].camera(camera).type, poses, target)
        yield f"target_track_{name}", _lists(seen)
        yield f"trace_{name}", _lists(trace_of(facts, camera))


def _images(file: EpisodeFile, plan: Plan) -> Iterator[tuple[str, pa.Array]]:
    for camera, name in plan.images.items():
        yield name, image_column(file.array(f"observation/{camera}/rgb").tolist())
    for (camera, sensor), name in plan.sensor_images.items():
        stored = file.has(f"observation/{camera}/{IMAGES[sensor]}")
        images = coded_images(file, camera, sensor) if stored else []
        yield name, image_column(images) if stored else pa.nulls(len(file), IMAGE)
    stored = file.has(POINTCLOUD)
    yield POINTCLOUD, _lists(file.array(POINTCLOUD)) if stored else pa.nulls(len(file), FLOATS)


def event_frames(facts: Facts) -> list[tuple[int, str, float]]:
    """Events as (frame, name, time s) in time order: the first frame at or after it, at most the
    last."""
    rows = []
    for event in sorted(facts.log.events, key=lambda e: (e.time, e.name)):
        frame = int(np.searchsorted(facts.log.times, event.time - CLOCK_TOLERANCE))
        rows.append((min(frame, len(facts) - 1), event.name, event.time))
    return rows


def _lists(values: NDArray[Any]) -> pa.Array:
    """A column of flat float32 lists from values (T,...)."""
    return pa.array(list(values.reshape(len(values), -1).astype(np.float32)), FLOATS)

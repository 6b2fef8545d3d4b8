"""The columns of the Parquet format: schema, and the table of one episode."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import SIDES
from pipeline.export.shared.annotations import Joined, annotation_columns
from pipeline.export.shared.derived import contact_flags, event_columns, interception, trace_of
from pipeline.export.shared.episodes import CLOCK_TOLERANCE, Facts
from pipeline.export.shared.labels import label_names, label_values, labelled
from pipeline.export.shared.script import script_of
from pipeline.export.shared.sensors import (
    IMAGE,
    IMAGES,
    POINTCLOUD,
    coded_images,
    image_column,
    sensors_of,
)
from pipeline.motion.paths import path_ahead
from pipeline.motion.recorded import track

VECTORS = ("state", "action", "target_pose", "target_velocity")
TOOLS = {side: f"tcp_{side}" for side in SIDES}
FLAGS = ("contact_target", "contact_manipulated", "held")
TEXTS = ("subtask", "skill", "stage")
CONSTANTS = {
    **{"task": pa.string(), "embodiment": pa.string(), "level": pa.int64(), "alpha": pa.float64()},
    **{"domain": pa.string(), "slot": pa.int64(), "seed": pa.int64()},
    **{"physics_id": pa.string(), "variant": pa.int64(), "instruction": pa.string()},
}


@dataclass(frozen=True)
class Plan:
    """What the columns follow from: fps, cameras, joint names by embodiment, sensors of any
    episode, annotations, corrections, angular velocity. `actions` are names of an action's numbers
    by embodiment, if not the joints; `labels` those of all objects. `eventful` and `paired`:
    whether there are events and arms of pairs."""

    fps: int
    cameras: Mapping[str, str]
    names: Mapping[str, list[str]]
    sensors: Collection[str]
    joined: Sequence[Joined]
    corrected: bool = False
    spins: bool = False
    actions: Mapping[str, list[str]] = field(default_factory=dict[str, list[str]])
    labels: Sequence[str] = ()
    eventful: bool = False
    paired: bool = False

    @property
    def images(self) -> dict[str, str]:
        """ "left_camera" -> "image_cam_left_wrist"."""
        return {camera: f"image_{name}" for camera, name in self.cameras.items()}

    @property
    def sensor_images(self) -> dict[tuple[str, str], str]:
        """("left_camera", "depth") -> "depth_cam_left_wrist"."""
        return {
            (c, sensor): f"{sensor}_{name}"
            for c, name in self.cameras.items()
            for sensor in IMAGES
            if sensor in self.sensors
        }

    def schema(self) -> pa.Schema:
        """With fps, joint names, annotations and Hugging Face features in the metadata."""
        columns: dict[str, pa.DataType] = dict.fromkeys(
            ("episode_index", "frame_index"), pa.int64()
        )
        columns["timestamp"] = pa.float64()
        columns |= CONSTANTS
        columns |= dict.fromkeys(TEXTS, pa.string())
        columns |= dict.fromkeys((*VECTORS, *TOOLS.values(), "target_path"), pa.list_(pa.float32()))
        if self.spins:
            columns["target_angular_velocity"] = pa.list_(pa.float32())
        columns |= {"events": pa.list_(pa.string()), "event_times": pa.list_(pa.float64())}
        columns |= {"is_first": pa.bool_(), "is_last": pa.bool_()}
        if self.labels:
            columns["objects"] = pa.list_(pa.string())
            columns |= dict.fromkeys(label_names(self.labels), pa.list_(pa.float32()))
        if self.corrected:
            columns |= {"intervention": pa.bool_(), "expert_action": pa.list_(pa.float32())}
        if self.eventful:
            columns |= {"event_kind": pa.string(), "event_active": pa.bool_(), "pair": pa.string()}
        columns |= {"arm": pa.string()} if self.paired else {}
        columns |= {"sim_step": pa.int64(), **dict.fromkeys(FLAGS, pa.list_(pa.bool_()))}
        for name in self.cameras.values():
            columns |= {
                f"{kind}_{name}": pa.list_(pa.float32())
                for kind in ("camera_pose", "target_track", "trace")
            }
        columns |= dict.fromkeys((*self.images.values(), *self.sensor_images.values()), IMAGE)
        columns |= {POINTCLOUD: pa.list_(pa.float32())} if POINTCLOUD in self.sensors else {}
        for one in self.joined:
            columns |= one.columns
        schema = pa.schema(list(columns.items()))
        described: dict[str, Any] = {
            "fps": self.fps,
            "cameras": list(self.images.values()),
            "names": dict(self.names),
        }
        if self.actions:
            described["action_names"] = dict(self.actions)
        if self.labels:
            described["label_names"] = label_names(self.labels)
        described["annotations"] = {
            j.directory: {
                "stage": j.stage,
                "columns": list(j.columns),
                "parameters": dict(j.parameters),
            }
            for j in self.joined
        }
        metadata = {
            "huggingface": json.dumps(
                {"info": {"features": {field.name: _feature(field.type) for field in schema}}}
            ),
            "domino": json.dumps(described, sort_keys=True),
        }
        return schema.with_metadata(metadata)


def _feature(kind: pa.DataType) -> dict[str, Any]:
    """The Hugging Face feature of an Arrow type."""
    if kind == IMAGE:
        return {"_type": "Image"}
    if isinstance(kind, pa.ListType):
        return {"feature": _feature(kind.value_type), "_type": "List"}
    if isinstance(kind, pa.StructType):
        return {field.name: _feature(field.type) for field in kind}
    return {
        "dtype": {"double": "float64", "float": "float32"}.get(str(kind), str(kind)),
        "_type": "Value",
    }


def episode_table(
    index: int, facts: Facts, file: EpisodeFile, plan: Plan, dataset: Path
) -> pa.Table:
    frames, log, derived, schema = len(facts), facts.log, interception(facts), plan.schema()
    spec = {name: value for name, value in vars(facts.spec).items() if name in CONSTANTS}
    spec |= {"physics_id": facts.meta.physics_id, "variant": facts.meta.variant}
    spec["instruction"] = facts.instruction
    columns: dict[str, Any] = {
        name: pa.array([value] * frames, CONSTANTS[name]) for name, value in spec.items()
    }
    columns["episode_index"] = np.full(frames, index)
    columns["frame_index"] = np.arange(frames)
    columns["timestamp"] = log.times - log.times[0]
    values = (log.state, facts.action, facts.target, log.target_velocity)
    for name, value in zip(VECTORS, values, strict=True):
        columns[name] = _lists(value)
    if plan.spins:
        columns["target_angular_velocity"] = _lists(np.array(log.target_angular_velocity))
    tools = dict(zip(log.sides, log.tcp.swapaxes(0, 1), strict=True))
    for side, name in TOOLS.items():
        columns[name] = (
            _lists(tools[side]) if side in tools else pa.nulls(frames, pa.list_(pa.float32()))
        )
    script = script_of(facts)
    columns |= {name: getattr(script, name) for name in TEXTS}
    columns["target_path"] = _lists(path_ahead(facts.target[:, :3], facts.fps))
    names: list[list[str]] = [[] for _ in range(frames)]
    times: list[list[float]] = [[] for _ in range(frames)]
    for frame, name, time in event_frames(facts):
        names[frame].append(name)
        times[frame].append(time - float(log.times[0]))
    columns["events"], columns["event_times"] = names, times
    columns["is_first"] = np.arange(frames) == 0
    columns["is_last"] = np.arange(frames) == frames - 1
    if plan.labels:
        columns["objects"] = [labelled(facts)] * frames
        columns |= {n: _lists(v) for n, v in label_values(facts, plan.labels).items()}
    if plan.corrected:
        columns["intervention"], columns["expert_action"] = (
            log.intervention,
            _lists(facts.written(np.array(log.expert_action), facts.representation)),
        )
    if plan.eventful:
        columns["event_kind"], active = event_columns(facts)
        columns["event_active"] = active > 0
        columns["pair"] = [facts.spec.pair] * frames
        columns["arm"] = [facts.spec.arm] * frames
    columns["sim_step"] = derived.steps
    touched = (contact_flags(facts, body) for body in (facts.meta.target, facts.meta.manipulated))
    for name, value in zip(FLAGS, (*touched, derived.held), strict=True):
        columns[name] = pa.array(list(value.astype(bool)), pa.list_(pa.bool_()))
    for camera, name in plan.cameras.items():
        poses = facts.camera_poses[camera]
        seen = track(
            facts.meta.drawing.cameras[camera].camera(camera).type, poses, facts.target[:, :3]
        )
        made = {"camera_pose": poses, "target_track": seen, "trace": trace_of(facts, camera)}
        columns |= {f"{kind}_{name}": _lists(value) for kind, value in made.items()}
    columns |= annotation_columns(plan.joined, dataset, file, facts)
    for camera, column in plan.images.items():
        columns[column] = image_column(file.array(f"observation/{camera}/rgb").tolist())
    for (camera, sensor), column in plan.sensor_images.items():
        stored = sensor in sensors_of(file, [camera])
        columns[column] = (
            image_column(coded_images(file, camera, sensor)) if stored else pa.nulls(frames, IMAGE)
        )
    if POINTCLOUD in plan.sensors:
        stored = file.has(POINTCLOUD)
        columns[POINTCLOUD] = (
            _lists(file.array(POINTCLOUD)) if stored else pa.nulls(frames, pa.list_(pa.float32()))
        )
    return pa.table({name: columns[name] for name in schema.names}, schema=schema)


def event_frames(facts: Facts) -> list[tuple[int, str, float]]:
    """(frame, name, time s) of every event in time order: the first frame at or after it, at most
    the last."""
    rows = []
    for event in sorted(facts.log.events, key=lambda e: (e.time, e.name)):
        frame = int(np.searchsorted(facts.log.times, event.time - CLOCK_TOLERANCE))
        rows.append((min(frame, len(facts) - 1), event.name, event.time))
    return rows


def _lists(values: NDArray[Any]) -> pa.Array:
    """A column of flat float32 lists from values (T,...)."""
    return pa.array(
        list(values.reshape(len(values), -1).astype(np.float32)), pa.list_(pa.float32())
    )

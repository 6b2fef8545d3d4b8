"""The files that DynamicWAM's converter reads: RoboTwin's layout with a group `interception` of
schema 2 (docs/exports.md), 14-wide vectors only. What has not happened by a frame is -1 or
zero."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import HEAD, LEFT_WRIST, OBSERVER, RIGHT_WRIST, SIDES
from pipeline.data.spec import EpisodeSpec
from pipeline.export.exporter import register
from pipeline.export.shared.derived import interception
from pipeline.export.shared.episodes import ExportError, Facts
from pipeline.export.shared.images import JpegOrder
from pipeline.motion.recorded import Interception
from pipeline.poses import compose

from .robotwin import (
    FRONT,
    CellExporter,
    configuration,
    drive_targets,
    episode_arrays,
    front_camera_option,
    tool_poses,
    written_cameras,
)

SCHEMA = 2
WIDTH = 14
CAMERAS = (HEAD, LEFT_WRIST, RIGHT_WRIST)
CONTACT = "target_gripper_contact"
TO_OPENCV = np.array([0, 0, 0, 0.5, -0.5, 0.5, -0.5])
"""From the axes of a camera body (x forward, y left, z up) to OpenCV's (x right, y down, z
forward)."""


def fields(facts: Facts, derived: Interception) -> dict[str, NDArray[Any]]:
    """The 25 fields of the group, frames first, arms left then right."""
    frames, log, start, rate = len(facts), facts.log, derived.motion_start, derived.rate

    def repeat(value: Any, dtype: type = np.float64) -> NDArray[Any]:
        return np.repeat(np.asarray(value, dtype)[None], frames, 0)

    grippers = [log.vector_names.index(f"{side}_gripper") for side in SIDES]
    cameras = np.stack([facts.camera_poses[camera] for camera in CAMERAS], axis=1)
    values = {
        "schema_version": repeat(SCHEMA, np.int64),
        "frame_index": np.arange(frames),
        "sim_step_index": derived.steps,
        "sim_time_seconds": derived.steps / rate,
        "sim_timestep_seconds": repeat(1 / rate),
        "motion_start_sim_step_index": repeat(round(start * rate), np.int64),
        "motion_start_sim_time_seconds": repeat(start + 0.0),
        "planned_intercept_sim_time_seconds": repeat(facts.meta.meeting_time),
        "planned_intercept_position": repeat(derived.planned_position),
        "target_pose_wxyz": facts.target,
        "target_contact_poses_wxyz": derived.grasp_pose()[:, None],
        "ee_poses_wxyz": tool_poses(log.tcp),
        "camera_poses_wxyz": compose(cameras, TO_OPENCV),
        "gripper_positions": drive_targets(log.state, log.action)[:, grippers],
        f"{CONTACT}_mask": derived.contact_pairs > 0,
        f"{CONTACT}_centroids_world": derived.contact_centroids,
        f"{CONTACT}_point_counts": derived.contact_points,
        "stable_grasp_succeeded": np.logical_or.accumulate(derived.held.any(1)),
    }
    shape = (frames, len(SIDES))
    first: dict[str, NDArray[Any]] = {
        "valid": np.zeros(shape, bool),
        "step_index": np.full(shape, -1),
        "time_seconds": np.full(shape, -1.0),
        "centroids_world": np.zeros((*shape, 3)),
        "point_counts": np.zeros(shape, np.int64),
        "ee_poses_wxyz": np.zeros((*shape, 7)),
        "target_poses_wxyz": np.zeros((*shape, 7)),
    }
    for arm, side in enumerate(SIDES):
        if contact := derived.first_contacts.get(side):
            since = int(np.searchsorted(derived.steps, contact.step))
            told = (True, contact.step, contact.step / rate, contact.point, contact.points)
            poses = (tool_poses(np.asarray(contact.tcp)), contact.target)
            for field, value in zip(first.values(), (*told, *poses), strict=True):
                field[since:, arm] = value
    return values | {f"first_{CONTACT}_{name}": field for name, field in first.items()}


@dataclass(frozen=True)
class DynamicwamOptions:
    front_camera: str | None = front_camera_option()


@register
class Dynamicwam(CellExporter[DynamicwamOptions]):
    name = "dynamicwam"
    options = DynamicwamOptions

    def place(self, spec: EpisodeSpec) -> str:
        return f"{spec.domain}/{configuration(spec)}"

    def order(self, options: DynamicwamOptions) -> JpegOrder:
        return "rgb"

    def arrays(
        self, file: EpisodeFile, facts: Facts, options: DynamicwamOptions
    ) -> dict[str, NDArray[Any]]:
        if len(facts.log.vector_names) != WIDTH:
            wide = f"{facts.source}: vectors of {facts.spec.embodiment} are not {WIDTH} wide"
            raise ExportError(f"{wide}, as DynamicWAM needs: name other robots with --embodiment")
        if missing := sorted(set(CAMERAS) - set(facts.cameras)):
            raise ExportError(f"{facts.source}: has no {missing[0]}, which DynamicWAM needs")
        arrays = episode_arrays(file, facts, self.cameras(facts, options), "rgb")
        group = fields(facts, interception(facts))
        return arrays | {f"interception/{name}": values for name, values in group.items()}

    def cameras(self, facts: Facts, options: DynamicwamOptions) -> dict[str, str]:
        fronts = (camera for camera in (FRONT, OBSERVER) if camera in facts.cameras)
        return written_cameras(facts, options.front_camera or next(fronts, None))

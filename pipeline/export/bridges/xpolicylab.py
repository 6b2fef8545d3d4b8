"""XPolicyLab's trajectory format v1.0 (docs/exports.md). `state[t]` is the joint target in force
at frame t, `action[t]` the one after it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import HEAD, LEFT_WRIST, OBSERVER, RIGHT_WRIST
from pipeline.data.spec import EpisodeSpec
from pipeline.export.exporter import register
from pipeline.export.formats.hdf5_files import Contents, Hdf5Exporter
from pipeline.export.options import jpeg_order_option
from pipeline.export.shared.episodes import ExportError, Facts, group_episodes
from pipeline.export.shared.images import DEPTH, POINTCLOUD

from .robotwin import FRONT, cell_parts, coded, drive_targets, tool_poses

CAMERAS = {HEAD: "cam_head", LEFT_WRIST: "cam_left_wrist", RIGHT_WRIST: "cam_right_wrist"}
THIRD_VIEW = (FRONT, OBSERVER)
"""Cameras that may be written as cam_third_view, the first that there is."""


@dataclass(frozen=True)
class XPolicyLabOptions:
    jpeg_order: Literal["rgb", "bgr"] = jpeg_order_option(
        "bgr for readers that decode with cv2 and never swap (XPolicyLab's own), rgb for all"
        " others",
        "bgr",
    )


@register
class XPolicyLab(Hdf5Exporter[XPolicyLabOptions]):
    name = "xpolicylab"
    options = XPolicyLabOptions
    written = (DEPTH, POINTCLOUD)

    def directories(self, episodes: Sequence[Path], out: Path) -> dict[Path, list[Path]]:
        return {out / name: paths for name, paths in group_episodes(episodes, _place).items()}

    def file(self, directory: Path, index: int) -> Path:
        return directory / "data" / f"episode_{index:07d}.hdf5"

    def cameras(self, facts: Facts, options: XPolicyLabOptions) -> dict[str, str]:
        third = next((camera for camera in THIRD_VIEW if camera in facts.cameras), None)
        places = CAMERAS | ({third: "cam_third_view"} if third else {})
        names = {camera: places[camera] for camera in facts.cameras if camera in places}
        if not names:
            known = ", ".join((*CAMERAS, *THIRD_VIEW))
            raise ExportError(f"{facts.source}: has none of {known}, the cameras of XPolicyLab")
        return names

    def contents(
        self, file: EpisodeFile, facts: Facts, options: XPolicyLabOptions, shared: None
    ) -> Contents:
        log, names = facts.log, facts.log.vector_names
        values: dict[str, NDArray[Any] | str] = {
            "data_format_version": "v1.0",
            "instruction": facts.instruction,
            "instructions": json.dumps(facts.seen, ensure_ascii=False),
            "additional_info/frequency": np.array(facts.fps, np.int32),
            "timestamp": log.times - log.times[0],
            "target/pose": facts.target,
            "target/velocity": log.target_velocity,
        }
        if log.target_angular_velocity is not None:
            values["target/angular_velocity"] = log.target_angular_velocity
        for group, vectors, tcp in (
            ("state", drive_targets(log.state, log.action), log.tcp),
            ("action", log.action, np.concatenate([log.tcp[1:], log.tcp[-1:]])),
        ):
            for i, side in enumerate(log.sides):
                gripper = names.index(f"{side}_gripper")
                arm = [j for j, n in enumerate(names) if n.startswith(f"{side}_") and j != gripper]
                parts = {
                    "arm_joint_states": vectors[:, arm],
                    "ee_joint_states": vectors[:, [gripper]],
                    "ee_poses": tool_poses(tcp[:, i]),
                    "tcp_poses": tcp[:, i],
                }
                for name, value in parts.items():
                    values[f"{group}/{side}_{name}"] = value.astype(np.float32)
        for camera, name in self.cameras(facts, options).items():
            below, shown = f"observation/{camera}", f"vision/{name}"
            values |= {
                f"{shown}/colors": coded(file, camera, options.jpeg_order),
                f"{shown}/shape": np.array([*facts.size, 3], np.int32),
                f"{shown}/intrinsic_matrix": file.array(f"{below}/intrinsic_cv"),
                f"{shown}/extrinsics_matrix": file.array(f"{below}/cam2world_gl"),
            }
            if file.has(f"{below}/depth"):
                values[f"{shown}/depths"] = file.array(f"{below}/depth")
        if file.has(POINTCLOUD):
            values["pointclouds"] = file.array(POINTCLOUD)
        return Contents(values, {"jpeg_order": options.jpeg_order, "spec": facts.spec.to_json()})


def _place(spec: EpisodeSpec) -> str:
    task, robot, level, domain = cell_parts(spec)
    # XPolicyLab separates these names by dots, and names of robots are those of its configuration
    # files
    return f"DOMINO_{level}_{domain}/{task}/{robot}".replace(".", "_").replace("-", "_")

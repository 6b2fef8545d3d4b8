"""Writes an episode file: the same episode gives the same bytes."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from pipeline.data.atomic import atomic_path
from pipeline.data.cameras import View, cam2world_gl, extrinsics_cv, intrinsics
from pipeline.data.keys import canonical
from pipeline.data.names import SIDES
from pipeline.poses import Floats32

from .events import by_role
from .file import ATTEMPTS, FIRST_CONTACT, SCHEMA, Episode
from .frames import encode_frames
from .hdf5 import HASHES, content_hashes, new_hdf5
from .state_log import Touch

_GROUPS = (
    *("instruction", "joint_action", "joint_state", "endpose", "target"),
    *("objects", "state", "observation", "interception"),
)


def write_episode(
    path: Path,
    episode: Episode,
    views: list[View],
    images: Sequence[NDArray[np.bytes_]] | None = None,
    pointcloud: Floats32 | None = None,
) -> None:
    """Write one episode atomically. `images`: JPEG frames (T,); `pointcloud` (T,N,6): m in the
    world, RGB 0-1. Raises OSError.
    """
    coded = [encode_frames(view.rgb) for view in views] if images is None else images
    with atomic_path(path) as temporary, new_hdf5(temporary) as f:
        # groups that h5py makes on the way to a dataset carry the time of day; these do not
        below = {
            "/".join(key.split("/")[:n])
            for key in episode.interception
            for n in range(1, key.count("/") + 1)
        }
        bodies = (f"objects/{body}" for body in episode.meta.objects)
        inner = (f"interception/{name}" for name in sorted(below))
        for name in (*_GROUPS, *bodies, *inner, FIRST_CONTACT):
            f.create_group(name)
        f.attrs["schema"], f.attrs["spec"] = SCHEMA, episode.spec.to_json()
        f.attrs["fps"], f.attrs["meta"] = episode.meta.fps, episode.meta.model_dump_json()
        f["motion"] = episode.motion
        f["events"] = json.dumps([asdict(event) for event in episode.log.events])
        f["skills"] = json.dumps([asdict(run) for run in episode.log.skills])
        if episode.attempts:
            f[ATTEMPTS] = json.dumps(list(episode.attempts), sort_keys=True)
        for split, texts in episode.instructions.items():
            f[f"instruction/{split}"] = np.array(texts, dtype=h5py.string_dtype())
        _write_log(f, episode)
        _write_touches(f.require_group(FIRST_CONTACT), episode)
        # the same bytes, whether it was just made or read from a file
        for key in sorted(episode.interception):
            f[f"interception/{key}"] = episode.interception[key]
        for view, frames in zip(views, coded, strict=True):
            _write_view(f.create_group(f"observation/{view.camera.name}"), view, frames)
        if pointcloud is not None:
            f.create_dataset("pointcloud", data=pointcloud, compression="gzip", compression_opts=4)
        f.attrs[HASHES] = canonical(content_hashes(f, np.asarray)).decode()


def _write_log(f: h5py.File, e: Episode) -> None:
    log = e.log
    f["timestamp"] = log.times
    names = list(log.vector_names)
    for group, vector in (("joint_action", log.action), ("joint_state", log.state)):
        for side in log.sides:
            own = [i for i, name in enumerate(names) if name.startswith(f"{side}_")]
            arm = [i for i in own if names[i] != f"{side}_gripper"]
            f[f"{group}/{side}_arm"] = vector[:, arm]
            f[f"{group}/{side}_gripper"] = vector[:, names.index(f"{side}_gripper")]
        f[f"{group}/vector"] = vector
        f[group].attrs["names"] = names
    if log.intervention is not None and log.expert_action is not None:
        f["intervention"], f["expert_action"] = log.intervention, log.expert_action
    for i, side in enumerate(log.sides):
        f[f"endpose/{side}_endpose"] = log.tcp[:, i]
        f[f"endpose/{side}_gripper"] = log.state[:, names.index(f"{side}_gripper")]
    f["target/pose"] = by_role(log, e.meta.events, e.meta.target).pose(e.meta.target)
    f["target/velocity"] = log.target_velocity
    if log.target_angular_velocity is not None:
        f["target/angular_velocity"] = log.target_angular_velocity
    f["target"].attrs["name"] = e.meta.target
    for name in e.meta.objects:
        f[f"objects/{name}/pose"] = log.pose(name)
    state = f.require_group("state")
    state.attrs["bodies"], state.attrs["joints"] = list(log.bodies), list(log.joints)
    for name in ("poses", "qpos", "qvel", "contacts"):
        state[name] = getattr(log, name)


def _write_touches(group: h5py.Group, e: Episode) -> None:
    """Rows left and right; an arm without touch has step -1."""
    by_side = {touch.side: touch for touch in e.log.touches}
    blank = {side: Touch(side, -1, (0.0,) * 3, 0, (0.0,) * 7, (0.0,) * 7) for side in SIDES}
    rows = list((blank | by_side).values())
    group["valid"] = np.array([row.step >= 0 for row in rows])
    group["time"] = np.array(
        [row.step / e.meta.physics_hz if row.step >= 0 else -1.0 for row in rows]
    )
    for name in ("step", "point", "points", "tcp", "target"):
        group[name] = np.array([getattr(row, name) for row in rows])


def _write_view(group: h5py.Group, view: View, coded: NDArray[np.bytes_]) -> None:
    group["rgb"] = coded
    group["intrinsic_cv"] = np.repeat(intrinsics(view.camera.type)[None], len(coded), 0)
    group["extrinsic_cv"] = extrinsics_cv(view.poses)
    group["cam2world_gl"] = cam2world_gl(view.poses)
    group["pose"] = view.poses
    if view.depth is not None:
        group.create_dataset("depth", data=view.depth, compression="gzip", compression_opts=4)
    if view.segmentation is not None:
        group.create_dataset(
            "actor_segmentation", data=view.segmentation, compression="gzip", compression_opts=4
        )

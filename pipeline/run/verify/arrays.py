"""Whether the arrays and images of an episode file are there, of the right type and shape, sound, and agree with each other."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import cam2world_gl, extrinsics_cv, intrinsics
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.jpeg import decode_frame, frame_size
from pipeline.data.episode.state_log import as_contacts
from pipeline.data.names import sides_of
from pipeline.run.verify.tally import FAULTS, Finding, line, observe

UNIT = 1e-3  # how far the length of a quaternion may be from 1
EXACT = 1e-9

type Shape = tuple[int, ...]


def shapes(file: EpisodeFile) -> dict[str, Shape]:
    """Shape of every float64 array that an episode has (docs/formats.md). Raises EpisodeError if names are missing."""
    frames = len(file)
    names = file.names("joint_state", "names")
    bodies, joints = len(file.names("state", "bodies")), len(file.names("state", "joints"))
    found: dict[str, Shape] = {"timestamp": (frames,), "target/pose": (frames, 7), "target/velocity": (frames, 3)}
    if file.has("target/angular_velocity"):
        found["target/angular_velocity"] = (frames, 3)
    for group in ("joint_action", "joint_state"):
        found[f"{group}/vector"] = (frames, len(names))
        for side in sides_of(names):
            arm = sum(n.startswith(f"{side}_") and n != f"{side}_gripper" for n in names)
            found |= {f"{group}/{side}_arm": (frames, arm), f"{group}/{side}_gripper": (frames,)}
    for side in sides_of(names):
        found |= {f"endpose/{side}_endpose": (frames, 7), f"endpose/{side}_gripper": (frames,)}
    if file.meta.corrects and not file.meta.failure:
        found["expert_action"] = (frames, len(names))
    found |= {f"objects/{name}/pose": (frames, 7) for name in file.meta.objects}
    found |= {"state/poses": (frames, bodies, 7), "state/qpos": (frames, joints), "state/qvel": (frames, joints)}
    for camera in file.cameras:
        matrices = {"intrinsic_cv": (3, 3), "extrinsic_cv": (3, 4), "cam2world_gl": (4, 4), "pose": (7,)}
        found |= {f"observation/{camera}/{key}": (frames, *shape) for key, shape in matrices.items()}
    return found


def check_arrays(file: EpisodeFile) -> Iterator[Finding]:
    """Types, shapes and finite values of all float arrays; the contacts; what is stored twice must be equal."""
    arrays: dict[str, NDArray[Any]] = {}
    for key, shape in shapes(file).items():
        try:
            values = file.array(key)
        except EpisodeError as error:
            yield Finding("arrays", str(error).removeprefix(f"{file.path}: "))
            continue
        right = values.shape == shape and values.dtype == np.float64
        yield observe("arrays", right, f"{key} is {values.dtype}{list(values.shape)}, not float64{list(shape)}")
        if right:
            arrays[key] = values
            yield observe("finite", np.isfinite(values).all(), f"{key} holds values that are not finite")
            # the joints of a seven-jointed arm are seven values, too
            if shape[-1:] == (7,) and not key.startswith(("joint_action/", "joint_state/")):
                length = np.linalg.norm(values[..., 3:], axis=-1)
                yield observe("quaternions", (np.abs(length - 1) < UNIT).all(), f"{key} has a quaternion that is no rotation")
    for key, wanted in _twice(file, arrays):
        yield observe("stored twice", np.allclose(arrays[key], wanted, atol=EXACT), f"{key} is not what the other arrays say")
    if (expert := arrays.get("expert_action")) is not None:
        yield _intervention(file, expert, arrays.get("joint_action/vector"))
    yield from _contacts(file)


def _intervention(file: EpisodeFile, expert: NDArray[Any], action: NDArray[Any] | None) -> Finding:
    """The policy acts first, then the expert, whose action is the one that is executed."""
    acts = file.array("intervention")
    right = acts.dtype == np.bool_ and acts.shape == expert.shape[:1] and bool(acts[-1])
    right = right and action is not None and np.array_equal(expert[acts], action[acts])
    return observe("arrays", right, "intervention is not what expert_action and joint_action/vector say")


def _twice(file: EpisodeFile, arrays: dict[str, NDArray[Any]]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Arrays that follow from others, and what they should be; those that are missing are left out."""
    names, bodies = file.names("joint_state", "names"), file.names("state", "bodies")
    for group in ("joint_action", "joint_state"):
        if (vector := arrays.get(f"{group}/vector")) is None:
            continue
        for side in sides_of(names):
            arm = [i for i, n in enumerate(names) if n.startswith(f"{side}_") and n != f"{side}_gripper"]
            yield f"{group}/{side}_arm", vector[:, arm]
            yield f"{group}/{side}_gripper", vector[:, names.index(f"{side}_gripper")]
            if group == "joint_state":
                yield f"endpose/{side}_gripper", vector[:, names.index(f"{side}_gripper")]
    if (poses := arrays.get("state/poses")) is not None:
        for body in file.meta.objects:
            yield f"objects/{body}/pose", poses[:, bodies.index(body)]
        yield "target/pose", poses[:, bodies.index(file.meta.target)]
    for camera, info in file.meta.drawing.cameras.items():
        group = f"observation/{camera}"
        if (pose := arrays.get(f"{group}/pose")) is not None:
            yield f"{group}/extrinsic_cv", extrinsics_cv(pose)
            yield f"{group}/cam2world_gl", cam2world_gl(pose)
            yield f"{group}/intrinsic_cv", np.repeat(intrinsics(info.camera(camera).type)[None], len(pose), 0)


def _contacts(file: EpisodeFile) -> Iterator[Finding]:
    try:
        rows = as_contacts(file.array("state/contacts"))
    except FAULTS as error:
        yield Finding("arrays", f"state/contacts: {line(error)}")
        return
    bodies = len(file.names("state", "bodies"))
    inside = (rows["frame"] >= 0) & (rows["frame"] < len(file)) & (rows["a"] >= 0) & (rows["a"] < rows["b"]) & (rows["b"] < bodies)
    finite = np.isfinite(rows["impulse"]) & np.isfinite(rows["point"]).all(-1)
    yield observe("contacts", (inside & finite).all(), "state/contacts names a frame or a body that there is not")


FLAT = 1.0  # standard deviation (0-255) below which an image is one flat color


def check_images(file: EpisodeFile) -> Iterator[Finding]:
    """Frames of every camera; depth, segmentation and point clouds where they are stored."""
    frames = len(file)
    for camera, info in file.meta.drawing.cameras.items():
        group, size = f"observation/{camera}", (info.width, info.height)
        coded = file.array(f"{group}/rgb")
        yield observe("frames", len(coded) == frames, f"{camera} has {len(coded)} images for {frames} timestamps")
        yield observe("jpeg", *_frames(camera, [bytes(data) for data in coded], size))
        for key, kind in (("depth", np.uint16), ("actor_segmentation", np.uint8)):
            if file.has(f"{group}/{key}"):
                values = file.array(f"{group}/{key}")
                right = values.shape == (frames, *reversed(size)) and values.dtype == kind
                yield observe("frames", right, f"{group}/{key} is {values.dtype}{list(values.shape)}")
    if set(file.cameras) != set(file.meta.drawing.cameras):
        yield Finding("frames", f"has cameras {', '.join(file.cameras)}, and names {', '.join(file.meta.drawing.cameras)}")
    if file.has("pointcloud"):
        cloud = file.array("pointcloud")
        right = cloud.ndim == 3 and len(cloud) == frames and cloud.shape[2] == 6 and bool(np.isfinite(cloud).all())
        yield observe("frames", right, f"pointcloud is {cloud.dtype}{list(cloud.shape)}, or not finite")


def _frames(camera: str, coded: list[bytes], size: tuple[int, int]) -> tuple[bool, str]:
    for t, jpeg in enumerate(coded):
        stated = frame_size(jpeg)
        if stated != size:
            return False, f"{camera} image {t} is {stated}, not {size} pixels"
        try:
            if decode_frame(jpeg).std() <= FLAT:
                return False, f"{camera} image {t} is one flat color"
        except EpisodeError:
            return False, f"{camera} image {t} does not decode"
    return True, ""

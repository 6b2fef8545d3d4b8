"""ALOHA HDF5 as ACT and its descendants read it: one `episode_{i}.hdf5` an episode, in the order of
the paths.

    observations/qpos (T,A) observations/qvel (T,A) action (T,A)          float32
    observations/left_arm_dim (T,) observations/right_arm_dim (T,)        joints of each arm, 6 or 7
    observations/images/{cam_high,cam_left_wrist,cam_right_wrist}         (T,H,W,3) uint8 RGB, or with --compress jpeg
                                                                          (T,N) uint8 JPEG bytes padded with zeros
    compress_len (cameras, T) float32 with --compress jpeg, cameras sorted  bytes of each JPEG
    is_pad (T,) with --pad-rows                                           true in the rows after the episode's end
    timestamp (T,), target/{pose (T,7), velocity (T,3), angular_velocity (T,3)}
    instructions/{seen,unseen}, motion
    attributes: sim True, compress, jpeg_order, length, fps, embodiment, names, cameras, instruction, spec, events

`action[t]` is the joint target commanded for the interval after frame t, so nothing is shifted and
no frame is dropped. Grippers are 0 closed to 1 open; their velocity is a finite difference. A is
the embodiment's own width (14 or 16). Several embodiments get a directory each. With --pad-rows the last
row is repeated up to the longest episode of the directory: the loader of ACT stacks the arrays of
all episodes. `length` is the number of rows before padding.
"""  # noqa: E501

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import SIDES
from pipeline.export.exporter import register
from pipeline.export.formats.hdf5_files import Contents, Hdf5Exporter
from pipeline.export.options import ActionOptions, camera_names_option, image_size, one_of, option
from pipeline.export.shared.episodes import (
    ExportError,
    Facts,
    by_embodiment,
    described_action,
    exported_cameras,
    reading,
)
from pipeline.export.shared.images import padded, reencode, resize


@dataclass(frozen=True)
class AlohaOptions(ActionOptions):
    """Options of the ALOHA format; `size` is (height, width) in pixels."""

    compress: Literal["jpeg", "none"] = option(
        "jpeg or none (raw RGB arrays)", one_of("jpeg", "none"), "none"
    )
    jpeg_order: Literal["rgb", "bgr"] = option(
        "rgb or bgr, with --compress jpeg", one_of("rgb", "bgr"), "rgb"
    )
    pad_rows: bool = option("repeat the last row up to the longest episode", default=False)
    size: tuple[int, int] | None = option(
        "WIDTHxHEIGHT in pixels to resize images to, like 640x480", image_size, None
    )
    camera_names: Mapping[str, str] = camera_names_option()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.jpeg_order == "bgr" and self.compress != "jpeg":
            raise ExportError("--jpeg-order bgr needs --compress jpeg: raw images are RGB arrays")


@register
class Aloha(Hdf5Exporter[AlohaOptions]):
    """One HDF5 file an episode."""

    name = "aloha"
    options = AlohaOptions

    def directories(self, episodes: Sequence[Path], out: Path) -> dict[Path, list[Path]]:
        return dict(by_embodiment(episodes, out).values())

    def file(self, directory: Path, index: int) -> Path:
        return directory / f"episode_{index}.hdf5"

    def cameras(self, facts: Facts, options: AlohaOptions) -> dict[str, str]:
        return exported_cameras(facts, options.camera_names)

    def shared(self, paths: Sequence[Path], options: AlohaOptions) -> int:
        """The rows that the files are padded to, 0 for no padding."""
        return _longest(paths) if options.pad_rows else 0

    def contents(
        self, file: EpisodeFile, facts: Facts, options: AlohaOptions, shared: int
    ) -> Contents:
        rows, coded = _rows(facts, shared), options.compress == "jpeg"
        images = {
            name: _images(file, camera, options)
            for camera, name in self.cameras(facts, options).items()
        }
        length, names = len(rows["action"]), sorted(images)
        values: dict[str, NDArray[Any]] = {
            **rows,
            "instructions/seen": np.array(facts.seen, h5py.string_dtype()),
            "instructions/unseen": np.array(facts.unseen, h5py.string_dtype()),
            "motion": np.array(facts.motion, h5py.string_dtype()),
        }
        for name in names:
            values[f"observations/images/{name}"] = _lengthen(
                padded(images[name]) if coded else np.stack(images[name]), length
            )
        if coded:
            sizes = [np.array([len(jpeg) for jpeg in images[name]], np.float32) for name in names]
            values["compress_len"] = np.stack([_lengthen(each, length) for each in sizes])
        attributes = {
            "sim": True,
            "compress": coded,
            "fps": facts.fps,
            "jpeg_order": options.jpeg_order,
            "length": len(facts),
            "embodiment": facts.spec.embodiment,
            "names": list(facts.log.vector_names),
            **described_action(facts),
            "cameras": names,
            "task": facts.spec.task,
            "instruction": facts.instruction,
            "spec": facts.spec.to_json(),
            "events": json.dumps([[e.name, e.time] for e in facts.log.events]),
        }
        return Contents(values, attributes, storage=_chunk)

    def sum_up(
        self, values: dict[str, Any], name: str, first: Facts, options: AlohaOptions
    ) -> None:
        values.setdefault("fps", {})[first.spec.embodiment] = first.fps
        values.setdefault("embodiments", []).append(first.spec.embodiment)


def _chunk(key: str, values: NDArray[Any]) -> dict[str, Any] | None:
    """Each image is a chunk of its own."""
    return {"chunks": (1, *values.shape[1:])} if key.startswith("observations/images/") else None


def _longest(paths: Sequence[Path]) -> int:
    lengths = []
    for path in paths:
        with reading(path) as file:
            lengths.append(len(file))
    return max(lengths)


def joint_velocity(facts: Facts) -> NDArray[np.float64]:
    """Measured velocities (T,A): joints in rad/s from the log, grippers (0-1) in 1/s by
    differences. Raises ExportError if the log lacks a joint."""
    log = facts.log
    columns = {name: i for i, name in enumerate(log.joints)}
    out = np.zeros_like(log.state)
    for i, name in enumerate(log.vector_names):
        if name in columns:
            out[:, i] = log.qvel[:, columns[name]]
        elif name.endswith("_gripper"):
            out[:, i] = np.gradient(log.state[:, i], 1.0 / facts.fps) if len(facts) > 1 else 0.0
        else:
            raise ExportError(f"{facts.source}: the state log has no joint {name}")
    return out


def _rows(facts: Facts, longest: int) -> dict[str, NDArray[Any]]:
    """Arrays by key, one row a frame, padded to `longest` rows."""
    log, names = facts.log, facts.log.vector_names
    joints = {
        side: sum(n.startswith(f"{side}_") and n != f"{side}_gripper" for n in names)
        for side in SIDES
    }
    arrays: dict[str, NDArray[Any]] = {
        "observations/qpos": log.state.astype(np.float32),
        "observations/qvel": joint_velocity(facts).astype(np.float32),
        "action": facts.action.astype(np.float32),
        "timestamp": log.times - log.times[0],
        "target/pose": facts.target.astype(np.float32),
        "target/velocity": log.target_velocity.astype(np.float32),
        **(
            {}
            if (spin := log.target_angular_velocity) is None
            else {"target/angular_velocity": spin.astype(np.float32)}
        ),
        **{
            f"observations/{side}_arm_dim": np.full(len(facts), count)
            for side, count in joints.items()
        },
    }
    if not longest:
        return arrays
    arrays = {key: _lengthen(values, longest) for key, values in arrays.items()}
    return arrays | {
        "timestamp": np.arange(longest) / facts.fps,
        "is_pad": np.arange(longest) >= len(facts),
    }


def _lengthen(values: NDArray[Any], length: int) -> NDArray[Any]:
    return values[np.minimum(np.arange(max(length, len(values))), len(values) - 1)]


def _images(file: EpisodeFile, camera: str, options: AlohaOptions) -> list[Any]:
    """JPEG bytes or RGB arrays (H,W,3) of the frames of a camera."""
    if options.compress == "jpeg":
        return [
            reencode(bytes(b), options.jpeg_order, options.size)
            for b in file.array(f"observation/{camera}/rgb")
        ]
    return [resize(frame, options.size) for frame in file.frames(camera)]

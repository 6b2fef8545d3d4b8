"""ALOHA HDF5 as ACT reads it (docs/exports.md). A is the embodiment's own width (14 or 16)."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.names import SIDES
from pipeline.export.exporter import register
from pipeline.export.options import ImageOptions, jpeg_order_option, one_of, option
from pipeline.export.shared.episodes import ExportError, Facts, described_action, reading
from pipeline.export.shared.images import padded, reencode, resize
from pipeline.poses import Floats, Floats32

from .hdf5_files import Contents, Hdf5Exporter


@dataclass(frozen=True)
class AlohaOptions(ImageOptions):
    compress: Literal["jpeg", "none"] = option(
        "jpeg or none (raw RGB arrays)", one_of("jpeg", "none"), "none"
    )
    jpeg_order: Literal["rgb", "bgr"] = jpeg_order_option("rgb or bgr, with --compress jpeg", "rgb")
    pad_rows: bool = option("repeat the last row up to the longest episode", default=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.jpeg_order == "bgr" and self.compress != "jpeg":
            raise ExportError("--jpeg-order bgr needs --compress jpeg: raw images are RGB arrays")


@register
class Aloha(Hdf5Exporter[AlohaOptions]):
    name = "aloha"
    options = AlohaOptions

    def file(self, directory: Path, index: int) -> Path:
        return directory / f"episode_{index}.hdf5"

    def shared(self, paths: Sequence[Path], options: AlohaOptions) -> int:
        """Rows of padded files, 0 for none: ACT's loader stacks episodes."""
        longest = 0
        for path in paths if options.pad_rows else ():
            with reading(path) as file:
                longest = max(longest, len(file))
        return longest

    def contents(
        self, file: EpisodeFile, facts: Facts, options: AlohaOptions, shared: int
    ) -> Contents:
        values, coded = _rows(facts, shared), options.compress == "jpeg"
        length, text = len(values["action"]), h5py.string_dtype()
        cameras = {name: camera for camera, name in self.cameras(facts, options).items()}
        values |= {
            "instructions/seen": np.array(facts.seen, text),
            "instructions/unseen": np.array(facts.unseen, text),
            "motion": np.array(facts.motion, text),
        }
        sizes = list[Floats32]()
        for name, camera in sorted(cameras.items()):
            images: list[Any]
            if coded:
                stored = file.array(f"observation/{camera}/rgb")
                images = [reencode(bytes(b), options.jpeg_order, options.size) for b in stored]
                sizes.append(_lengthen(np.array([*map(len, images)], np.float32), length))
            else:
                images = [resize(frame, options.size) for frame in file.frames(camera)]
            rows = padded(images) if coded else np.stack(images)
            values[f"observations/images/{name}"] = _lengthen(rows, length)
        if coded:
            values["compress_len"] = np.stack(sizes)
        attributes = {
            "sim": True,
            "compress": coded,
            "fps": facts.fps,
            "jpeg_order": options.jpeg_order,
            "length": len(facts),
            "embodiment": facts.spec.embodiment,
            "names": list(facts.log.vector_names),
            **described_action(facts),
            "cameras": sorted(cameras),
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
    return {"chunks": (1, *values.shape[1:])} if key.startswith("observations/images/") else None


def joint_velocity(facts: Facts) -> Floats:
    """Measured velocities (T,A): joints in rad/s, grippers (0-1) in 1/s by differences."""
    log, velocity = facts.log, np.zeros_like(facts.log.state)
    for i, name in enumerate(log.vector_names):
        if name in log.joints:
            velocity[:, i] = log.qvel[:, log.joints.index(name)]
        elif not name.endswith("_gripper"):
            raise ExportError(f"{facts.source}: the state log has no joint {name}")
        elif len(facts) > 1:
            velocity[:, i] = np.gradient(log.state[:, i], 1.0 / facts.fps)
    return velocity


def _rows(facts: Facts, longest: int) -> dict[str, NDArray[Any]]:
    log, spin = facts.log, facts.log.target_angular_velocity
    arrays: dict[str, NDArray[Any]] = {
        "observations/qpos": log.state.astype(np.float32),
        "observations/qvel": joint_velocity(facts).astype(np.float32),
        "action": facts.action.astype(np.float32),
        "timestamp": log.times - log.times[0],
        "target/pose": facts.target.astype(np.float32),
        "target/velocity": log.target_velocity.astype(np.float32),
        **({} if spin is None else {"target/angular_velocity": spin.astype(np.float32)}),
    }
    for side in SIDES:
        names = {n for n in log.vector_names if n.startswith(f"{side}_")} - {f"{side}_gripper"}
        arrays[f"observations/{side}_arm_dim"] = np.full(len(facts), len(names))
    if not longest:
        return arrays
    arrays = {key: _lengthen(values, longest) for key, values in arrays.items()}
    times, is_pad = np.arange(longest) / facts.fps, np.arange(longest) >= len(facts)
    return arrays | {"timestamp": times, "is_pad": is_pad}


def _lengthen(values: NDArray[Any], length: int) -> NDArray[Any]:
    return values[np.minimum(np.arange(max(length, len(values))), len(values) - 1)]

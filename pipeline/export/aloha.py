"""ALOHA HDF5 as ACT and its descendants read it: one `episode_{i}.hdf5` an episode, in the order of the paths.

    observations/qpos (T,A) observations/qvel (T,A) action (T,A)          float32
    observations/left_arm_dim (T,) observations/right_arm_dim (T,)        joints of each arm, 6 or 7
    observations/images/{cam_high,cam_left_wrist,cam_right_wrist}         (T,H,W,3) uint8 RGB, or with --compress jpeg
                                                                          (T,N) uint8 JPEG bytes padded with zeros
    compress_len (cameras, T) float32 with --compress jpeg, cameras sorted  bytes of each JPEG
    is_pad (T,) with --pad                                                true in the rows after the episode's end
    timestamp (T,), target/{pose (T,7), velocity (T,3)}, instructions/{seen,unseen}, motion
    attributes: sim True, compress, jpeg_order, length, fps, embodiment, names, cameras, instruction, spec, events

`action[t]` is the joint target commanded for the interval after frame t, so nothing is shifted and no frame is dropped. Grippers
are 0 closed to 1 open; their velocity is a finite difference. A is the embodiment's own width (14 or 16). Several embodiments get a
directory each. With --pad the last row is repeated up to the longest episode of the directory: the loader of ACT stacks the arrays
of all episodes. `length` is the number of rows before padding.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.hdf5 import new_hdf5, open_hdf5
from pipeline.data.names import SIDES
from pipeline.export.common import (
    ExportError,
    Facts,
    by_embodiment,
    exported_cameras,
    judging,
    make_groups,
    read_facts,
    read_summary,
    reading,
)
from pipeline.export.exporter import Exporter, Job, register
from pipeline.export.hdf5_files import find_misplaced, write_files
from pipeline.export.images import decode_jpeg, padded, reencode, resize
from pipeline.export.options import camera_names_option, image_size, one_of, option
from pipeline.export.provenance import PROVENANCE, check_provenance


@dataclass(frozen=True)
class AlohaOptions:
    """Options of the ALOHA format; `size` is (height, width) in pixels."""

    compress: Literal["jpeg", "none"] = option("jpeg or none (raw RGB arrays)", one_of("jpeg", "none"), "none")
    jpeg_order: Literal["rgb", "bgr"] = option("rgb or bgr, with --compress jpeg", one_of("rgb", "bgr"), "rgb")
    pad: bool = option("repeat the last row up to the longest episode", default=False)
    size: tuple[int, int] | None = option("WIDTHxHEIGHT in pixels to resize images to, like 640x480", image_size, None)
    camera_names: Mapping[str, str] = camera_names_option()

    def __post_init__(self) -> None:
        if self.jpeg_order == "bgr" and self.compress != "jpeg":
            raise ExportError("--jpeg-order bgr needs --compress jpeg: raw images are RGB arrays")


@register
class Aloha(Exporter[AlohaOptions]):
    """One HDF5 file an episode."""

    name = "aloha"
    options = AlohaOptions

    def export(self, job: Job[AlohaOptions]) -> dict[str, Any]:
        """Write `job.out`, or a directory of it for each of several embodiments. Raises ExportError for unreadable episodes and
        for episodes of one embodiment that differ in fps, cameras, image size or joint names."""
        with self.draft(job) as draft:
            folder, frames, fps = draft.folder, 0, {}
            groups = by_embodiment(job.episodes, folder)
            for name, (directory, paths) in groups.items():
                longest = _longest(paths) if job.options.pad else 0

                def write(made: Path, file: EpisodeFile, facts: Facts, longest: int = longest) -> None:
                    _write(made, _rows(facts, longest), _images(file, facts, job.options), facts, job.options)

                for facts in write_files(draft, job, directory, _places(directory, paths), write, (longest,)):
                    frames += len(facts)
                    fps[name] = facts.fps
            values = {"episodes": sum(len(p) for _, p in groups.values()), "frames": frames, "fps": fps}
            return self.summarize(folder, job, values | {"embodiments": sorted(groups)})

    def compare(self, dataset: Path, out: Path, episodes: Sequence[Path], options: AlohaOptions) -> list[str]:
        """Vectors and images must be equal bit by bit; images that the export resized or encoded again are made again here."""
        summary = read_summary(out)
        problems: list[str] = []
        groups = by_embodiment(episodes, out)
        if sorted(groups) != summary.get("embodiments"):
            problems.append(f"{out}: holds embodiments {summary.get('embodiments')}, the dataset {sorted(groups)}")
        for directory, paths in groups.values():
            longest = _longest(paths) if options.pad else 0
            places, found = _places(directory, paths), {*directory.glob("episode_*.hdf5")}
            problems += find_misplaced(places.values(), found)
            for path, exported in places.items():
                if exported in found:
                    with reading(path) as file:
                        facts = read_facts(file, dataset)
                        with judging(exported, problems), open_hdf5(exported) as f:
                            problems += [f"{exported}: {p} {path}" for p in _compare(f, file, facts, longest, options)]
            with judging(directory / PROVENANCE, problems):
                problems += check_provenance(directory / PROVENANCE, dataset, paths)
        return problems


def _places(directory: Path, paths: Sequence[Path]) -> dict[Path, Path]:
    return {path: directory / f"episode_{index}.hdf5" for index, path in enumerate(paths)}


def _longest(paths: Sequence[Path]) -> int:
    lengths = []
    for path in paths:
        with reading(path) as file:
            lengths.append(len(file))
    return max(lengths)


def joint_velocity(facts: Facts) -> NDArray[np.float64]:
    """Measured velocities (T,A) of the state vector: joints in rad/s by name from the log, grippers (0-1) in 1/s by differences.

    Raises ExportError if the log does not hold a joint of the vector.
    """
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
    """Arrays by key with one row a frame, their last row repeated up to `longest` rows where they are fewer."""
    log, names = facts.log, facts.log.vector_names
    joints = {side: sum(n.startswith(f"{side}_") and n != f"{side}_gripper" for n in names) for side in SIDES}
    arrays: dict[str, NDArray[Any]] = {
        "observations/qpos": log.state.astype(np.float32),
        "observations/qvel": joint_velocity(facts).astype(np.float32),
        "action": log.action.astype(np.float32),
        "timestamp": log.times - log.times[0],
        "target/pose": facts.target.astype(np.float32),
        "target/velocity": log.target_velocity.astype(np.float32),
        **{f"observations/{side}_arm_dim": np.full(len(facts), count) for side, count in joints.items()},
    }
    if not longest:
        return arrays
    arrays = {key: _lengthen(values, longest) for key, values in arrays.items()}
    return arrays | {"timestamp": np.arange(longest) / facts.fps, "is_pad": np.arange(longest) >= len(facts)}


def _lengthen(values: NDArray[Any], length: int) -> NDArray[Any]:
    """Rows with the last one repeated up to `length` rows."""
    return values[np.minimum(np.arange(max(length, len(values))), len(values) - 1)]


def _images(file: EpisodeFile, facts: Facts, options: AlohaOptions) -> dict[str, list[Any]]:
    """Exported camera -> JPEG bytes or RGB arrays (H,W,3) of its frames."""
    images: dict[str, list[Any]] = {}
    for camera, name in exported_cameras(facts, options.camera_names).items():
        stored = [bytes(b) for b in file.array(f"observation/{camera}/rgb")]
        if options.compress == "jpeg":
            images[name] = [reencode(b, options.jpeg_order, options.size) for b in stored]
        else:
            frames = (decode_jpeg(b, "rgb") for b in stored)
            images[name] = [f if options.size is None else resize(f, options.size) for f in frames]
    return images


def _write(
    path: Path, rows: Mapping[str, NDArray[Any]], images: Mapping[str, list[Any]], facts: Facts, options: AlohaOptions
) -> None:
    log, length = facts.log, len(rows["action"])
    with new_hdf5(path, rdcc_nbytes=2 * 1024**2) as f:
        f.attrs["sim"], f.attrs["compress"], f.attrs["fps"] = True, options.compress == "jpeg", facts.fps
        f.attrs["jpeg_order"], f.attrs["length"] = options.jpeg_order, len(facts)
        f.attrs["embodiment"], f.attrs["names"] = facts.spec.embodiment, list(log.vector_names)
        f.attrs["cameras"] = sorted(images)
        f.attrs["task"], f.attrs["instruction"], f.attrs["spec"] = facts.spec.task, facts.instruction, facts.spec.to_json()
        f.attrs["events"] = json.dumps([[e.name, e.time] for e in log.events])
        make_groups(f, [*rows, "instructions/seen", "observations/images/camera"])
        for key, values in rows.items():
            f[key] = values
        f["instructions/seen"] = np.array(facts.seen, dtype=h5py.string_dtype())
        f["instructions/unseen"] = np.array(facts.unseen, dtype=h5py.string_dtype())
        f["motion"] = facts.motion
        for name in sorted(images):
            data = _lengthen(padded(images[name]) if f.attrs["compress"] else np.stack(images[name]), length)
            f.create_dataset(f"observations/images/{name}", data=data, chunks=(1, *data.shape[1:]))
        if f.attrs["compress"]:
            lengths = [_lengthen(np.array([len(jpeg) for jpeg in images[name]], np.float32), length) for name in sorted(images)]
            f["compress_len"] = np.stack(lengths)


def _compare(f: Any, file: EpisodeFile, facts: Facts, longest: int, options: AlohaOptions) -> list[str]:
    problems = []
    for key, want in _rows(facts, longest).items():
        if not np.array_equal(f[key][()], want):
            problems.append(f"{key} differs from")
    if f.attrs["fps"] != facts.fps or f.attrs["length"] != len(facts):
        problems.append("fps or length differs from")
    if list(f.attrs["names"]) != list(facts.log.vector_names):
        problems.append("joint names differ from")
    said = {"task": facts.spec.task, "instruction": facts.instruction, "spec": facts.spec.to_json()}
    problems += [f"{name} differs from" for name, want in said.items() if f.attrs[name] != want]
    for split, want in (("seen", facts.seen), ("unseen", facts.unseen)):
        if [text.decode() for text in f[f"instructions/{split}"][()]] != want:
            problems.append(f"instructions/{split} differ from")
    order = list(f.attrs["cameras"])
    for camera, name in exported_cameras(facts, options.camera_names).items():
        data = f[f"observations/images/{name}"]
        lengths = f["compress_len"][order.index(name)].astype(int) if f.attrs["compress"] else None
        if len(data) != max(longest, len(facts)):
            problems.append(f"{name} has {len(data)} images for the {max(longest, len(facts))} frames of")
        elif (wrong := _wrong_image(file, camera, data, lengths, options)) is not None:
            problems.append(f"{name} image {wrong} differs from")
    return problems


def _wrong_image(file: EpisodeFile, camera: str, data: Any, lengths: Any, options: AlohaOptions) -> int | None:
    """The first image of a camera that is not the episode's, or None."""
    for t in range(len(data)):
        stored = file.jpeg(camera, min(t, len(file) - 1))
        if lengths is not None:
            if data[t][: lengths[t]].tobytes() != reencode(stored, options.jpeg_order, options.size):
                return t
            continue
        want = decode_jpeg(stored, "rgb")
        if not np.array_equal(data[t], want if options.size is None else resize(want, options.size)):
            return t
    return None

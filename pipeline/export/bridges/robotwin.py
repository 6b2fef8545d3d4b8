"""RoboTwin's files (layout: docs/exports.md). The original stores the drive targets in force at
a frame; ours are for the interval after it, so they move by one."""

import json
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.meta import EpisodeMeta
from pipeline.data.names import CAMERAS
from pipeline.data.recipe.model import Cell
from pipeline.data.spec import EpisodeSpec
from pipeline.export.exporter import register
from pipeline.export.formats.hdf5_files import Contents, Hdf5Exporter
from pipeline.export.options import jpeg_order_option, option
from pipeline.export.shared.episodes import ExportError, Facts, group_episodes
from pipeline.export.shared.images import POINTCLOUD, SENSORS, JpegOrder, reencode
from pipeline.export.shared.record import json_text
from pipeline.poses import Floats, Pixels, compose, pose

FRONT = "front_camera"
BEHIND_TCP = 0.12  # m
CAMERA_MATRICES = ("intrinsic_cv", "extrinsic_cv", "cam2world_gl")
COMPRESSED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def drive_targets(measured: Floats, commanded: Floats) -> Floats:
    """The targets (T,...) in force at each frame: the command before it, at first the measured."""
    return np.concatenate([measured[:1], commanded[:-1]])


def tool_poses(tcp: Floats) -> Floats:
    """The original's tool poses (...,7): behind the tcp along its x axis."""
    return compose(tcp, pose((-BEHIND_TCP, 0, 0)))


def cell_parts(spec: EpisodeSpec) -> list[str]:
    return Cell.of(spec).path.split("/")


def configuration(spec: EpisodeSpec) -> str:
    task, *rest = cell_parts(spec)
    return f"{task}/{'_'.join(rest)}"


class CellExporter[O](Hdf5Exporter[O]):
    """One directory a cell, an HDF5 file and instructions an episode."""

    written = SENSORS

    @abstractmethod
    def place(self, spec: EpisodeSpec) -> str: ...

    @abstractmethod
    def arrays(self, file: EpisodeFile, facts: Facts, options: O) -> dict[str, NDArray[Any]]:
        """Every array of a file by key. Raises ExportError."""

    @abstractmethod
    def order(self, options: O) -> JpegOrder: ...

    def directories(self, episodes: Sequence[Path], out: Path) -> dict[Path, list[Path]]:
        return {out / name: paths for name, paths in group_episodes(episodes, self.place).items()}

    def file(self, directory: Path, index: int) -> Path:
        return directory / "data" / f"episode{index}.hdf5"

    def contents(self, file: EpisodeFile, facts: Facts, options: O, shared: None) -> Contents:
        arrays = self.arrays(file, facts, options)
        spec, order = facts.spec.to_json(), self.order(options)
        attributes = {"jpeg_order": order, "fps": facts.fps, "spec": spec}
        painted = any(key.endswith("/actor_segmentation") for key in arrays)
        of_groups = {"observation": {"bodies": list(facts.log.bodies)}} if painted else {}
        return Contents(arrays, attributes, storage=_storage, of_groups=of_groups, cache=None)

    def note(self, directory: Path, index: int, facts: Facts) -> dict[str, Any]:
        path = directory / "instructions" / f"episode{index}.json"
        path.parent.mkdir(exist_ok=True)
        path.write_text(json_text({"seen": facts.seen, "unseen": facts.unseen}))
        return scene(facts.spec, facts.meta)

    def sum_up(self, values: dict[str, Any], name: str, first: Facts, options: O) -> None:
        values.setdefault("configurations", []).append(name)


def _storage(key: str, values: NDArray[Any]) -> dict[str, Any] | None:
    """Sensors are compressed; depth is float64, as in the original."""
    if key.endswith("/depth"):
        return COMPRESSED | {"dtype": np.float64}
    return COMPRESSED if key.endswith("/actor_segmentation") else None


def episode_arrays(
    file: EpisodeFile, facts: Facts, names: Mapping[str, str], order: JpegOrder
) -> dict[str, NDArray[Any]]:
    log = facts.log
    arrays = {key: file.array(key) for key in ("timestamp", "target/pose", "target/velocity")}
    if log.target_angular_velocity is not None:
        arrays["target/angular_velocity"] = log.target_angular_velocity
    parts = [f"{side}_{part}" for side in log.sides for part in ("arm", "gripper")]
    for part in ("vector", *parts):
        arrays[f"joint_state/{part}"] = measured = file.array(f"joint_state/{part}")
        arrays[f"joint_action/{part}"] = drive_targets(measured, file.array(f"joint_action/{part}"))
    for side, tools in zip(log.sides, tool_poses(log.tcp).swapaxes(0, 1), strict=True):
        arrays[f"endpose/{side}_endpose"] = tools
        arrays[f"endpose/{side}_gripper"] = arrays[f"joint_action/{side}_gripper"]
    for camera, name in names.items():
        stored, written = f"observation/{camera}", f"observation/{name}"
        for matrix in CAMERA_MATRICES:
            arrays[f"{written}/{matrix}"] = file.array(f"{stored}/{matrix}")
        arrays[f"{written}/rgb"] = coded(file, camera, order)
        if file.has(f"{stored}/depth"):
            arrays[f"{written}/depth"] = file.array(f"{stored}/depth")
        if file.has(f"{stored}/actor_segmentation"):
            labels = file.array(f"{stored}/actor_segmentation")
            arrays[f"{written}/actor_segmentation"] = painted(labels)
    return arrays | ({POINTCLOUD: file.array(POINTCLOUD)} if file.has(POINTCLOUD) else {})


def painted(labels: Pixels) -> Pixels:
    """Segmentation (...) in the original's colors (...,3). Raises ExportError."""
    colors = sorted(set(ImageColor.colormap.values()))
    if labels.max() >= len(colors):
        held = f"the original has {len(colors)} colors"
        raise ExportError(f"segmentation with body {labels.max()} cannot be painted: {held}")
    return np.array([ImageColor.getrgb(color) for color in colors], np.uint8)[labels]


def coded(file: EpisodeFile, camera: str, order: JpegOrder) -> NDArray[np.bytes_]:
    """JPEG bytes (T,) in that order, padded with zeros."""
    stored = file.array(f"observation/{camera}/rgb")
    if order == "rgb":
        return stored
    images = [reencode(bytes(jpeg), order) for jpeg in stored]
    return np.array(images, dtype=f"S{max(map(len, images))}")


def front_camera_option() -> Any:
    help = "stored camera to write as front_camera: observer, or the name of one that the recipe"
    return option(f"{help} describes", lambda text: CAMERAS.get(text, text), None)


def written_cameras(facts: Facts, front: str | None) -> dict[str, str]:
    """Exported names by camera; `front` becomes front_camera. Raises ExportError."""
    names = {camera: FRONT if camera == front else camera for camera in facts.cameras}
    problem = ""
    if front is not None and front not in names:
        problem = f"has no {front}; its cameras are {', '.join(names)}"
    elif front not in (None, FRONT) and FRONT in names:
        problem = f"has a {FRONT} already; leave the option out"
    if problem:
        raise ExportError(f"--front-camera: {facts.source} {problem}")
    return names


@dataclass(frozen=True)
class RobotwinOptions:
    jpeg_order: Literal["rgb", "bgr"] = jpeg_order_option(
        "bgr for converters that decode with cv2 and never swap (RoboTwin's own), rgb for all other"
        " readers"
    )
    front_camera: str | None = front_camera_option()


@register
class Robotwin(CellExporter[RobotwinOptions]):
    name = "robotwin"
    options = RobotwinOptions

    def place(self, spec: EpisodeSpec) -> str:
        return configuration(spec)

    def order(self, options: RobotwinOptions) -> JpegOrder:
        return options.jpeg_order

    def arrays(
        self, file: EpisodeFile, facts: Facts, options: RobotwinOptions
    ) -> dict[str, NDArray[Any]]:
        return episode_arrays(file, facts, self.cameras(facts, options), options.jpeg_order)

    def cameras(self, facts: Facts, options: RobotwinOptions) -> dict[str, str]:
        return written_cameras(facts, options.front_camera)

    def finish(self, directory: Path, validation: float, notes: Sequence[Any]) -> None:
        scenes = {f"episode_{index}": note for index, note in enumerate(notes)}
        (directory / "scene_info.json").write_text(json_text(scenes))
        seeds = " ".join(str(note["spec"]["seed"]) for note in notes)
        (directory / "seed.txt").write_text(seeds + "\n")


def scene(spec: EpisodeSpec, meta: EpisodeMeta) -> dict[str, Any]:
    """{A} is manipulated, {B} the target if another one, {a} and {b} are the arms."""
    bodies = [meta.objects[name] for name in dict.fromkeys((meta.manipulated, meta.target))]
    info = {f"{{{x}}}": body.description for x, body in zip("AB", bodies, strict=False)}
    info |= {f"{{{x}}}": side for x, side in zip("ab", meta.arms.values(), strict=False)}
    clutter, plain = list(meta.clutter), json.loads(spec.to_json())
    return {"info": info, "cluttered_table_info": clutter, "spec": plain}

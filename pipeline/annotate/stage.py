"""A stage of annotation: read (input hashes) -> decode (on a thread) -> compute -> store."""

import hashlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import View
from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.frames import decode_frame
from pipeline.data.episode.world import WorldTruth
from pipeline.data.errors import DominoError
from pipeline.data.keys import arrays_digest, canonical, frames_digest
from pipeline.data.slots.annotations import scene_input
from pipeline.poses import Floats, Pixels

MOST_STRIDE = 600
"""Frames between the two images of a flow pair at most: ten seconds at the highest recording
rate."""

MOST_POINTS = 4096


class AnnotateError(DominoError): ...


def digest(value: Any) -> str:
    return hashlib.sha256(canonical(value)).hexdigest()


def annotation_key(
    stage: str, version: int, parameters: Mapping[str, Any], inputs: Mapping[str, Any]
) -> str:
    of_stage = {"stage": stage, "version": version, "parameters": dict(parameters)}
    return digest(of_stage | {"inputs": dict(inputs)})


def stage_key(stage: str, version: int, parameters: Mapping[str, Any]) -> str:
    """The first 8 hex digits of the key without its inputs."""
    return digest({"stage": stage, "version": version, "parameters": dict(parameters)})[:8]


Render = Callable[[Path, str], View]
"""Renders an episode file again from one camera, with depth and segmentation."""

Truth = Callable[[Path, str], WorldTruth]
"""What the simulator knows of an episode file in one camera."""


@dataclass(frozen=True)
class Redraw:
    """Draws stored episodes again and states simulator truth; None if impossible."""

    render: Render | None = None
    truth: Truth | None = None


class NotReady(Exception):
    """An episode's input is missing (features before masks); the message names it."""


@dataclass(eq=False)
class Reading:
    """Plain `inputs` for the key, and `decode`, called while the file is open."""

    inputs: Mapping[str, Any]
    decode: Callable[[], Any]


@dataclass(eq=False)
class StageResult:
    """Arrays by absolute frame, attributes, and which arrays to compress."""

    arrays: Mapping[str, NDArray[Any]]
    attributes: Mapping[str, Any]
    compressed: Collection[str] = field(default=())


class Stage(Protocol):
    """One stage for one camera. Raise `version` by hand when the code changes the bytes."""

    @property
    def name(self) -> str: ...

    @property
    def version(self) -> int: ...

    @property
    def camera(self) -> str: ...

    @property
    def uses_models(self) -> bool: ...

    def parameters(self) -> dict[str, Any]:
        """All that decides the result besides the inputs, as JSON."""
        ...

    def read(self, episode: EpisodeFile, dataset: Path, relative: Path) -> Reading:
        """Hash the inputs of an open episode. Raises NotReady, AnnotateError."""
        ...

    def start(self) -> Callable[[Any], StageResult]:
        """Load models, once per worker; returns the computation."""
        ...


def directory_of(stage: Stage) -> str:
    return f"{stage.name}@{stage_key(stage.name, stage.version, stage.parameters())}"


def encoded_frames(episode: EpisodeFile, camera: str) -> list[bytes]:
    check_camera(episode, camera)
    return [bytes(data) for data in episode.array(f"observation/{camera}/rgb")]


def check_camera(episode: EpisodeFile, camera: str) -> None:
    if camera not in episode.cameras:
        known = ", ".join(episode.cameras)
        raise AnnotateError(f"{episode.path} has no camera {camera}: it has {known}")


def frames_inputs(frames: list[bytes]) -> dict[str, Any]:
    return {"frames": frames_digest(frames)}


def decode_frames(frames: list[bytes]) -> Pixels:
    return np.stack([decode_frame(data) for data in frames])


@dataclass(eq=False)
class SimView:
    """Segmentation (T,H,W) of body index + 1, depth (T,H,W) mm or None, world poses (T,7), K
    (3,3).
    """

    segmentation: Pixels
    depth: NDArray[np.uint16] | None
    poses: Floats
    k: Floats


def sim_reading(
    episode: EpisodeFile, camera: str, depth: bool, render: Render | None
) -> tuple[dict[str, Any], Callable[[], SimView], list[str]]:
    """Inputs, lazy view and body names of simulator truth, stored or rendered. Raises
    AnnotateError."""
    check_camera(episode, camera)
    log, drawing, path = episode.read().log, episode.meta.drawing, episode.path
    group, bodies, sensors = f"observation/{camera}", list(log.bodies), drawing.sensors
    poses, k = episode.array(f"{group}/pose"), episode.array(f"{group}/intrinsic_cv")[0]
    names = ["actor_segmentation", *(["depth"] if depth else [])]
    scene = scene_input(episode, log, camera)
    noisy = depth and sensors is not None and sensors.depth_noise is not None
    try:
        stored = {} if noisy else {key: episode.array(f"{group}/{key}") for key in names}
    except EpisodeError:
        stored = {}
    if stored:
        view = SimView(stored["actor_segmentation"], stored.get("depth"), poses, k)
        return {"scene": scene, "stored": arrays_digest(stored)}, lambda: view, bodies
    if render is None:
        raise AnnotateError(f"{path} stores no {' and '.join(names)} of {camera}, nor is drawn")

    def again() -> SimView:
        v = render(path, camera)
        if v.segmentation is None or (depth and v.depth is None):
            raise AnnotateError(f"rendering {path} again gave no {' and '.join(names)}")
        return SimView(v.segmentation, v.depth, v.poses, k)

    return {"scene": scene, "assets": drawing.assets}, again, bodies

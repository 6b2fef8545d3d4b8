"""Where cameras sit, and which of them a setup wants."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from pipeline.data.cameras import CAMERA_TYPES, Camera, CameraType, look
from pipeline.data.episode.meta import NamedCamera, camera_name
from pipeline.data.errors import DominoError
from pipeline.data.names import CAMERAS, HEAD, OBSERVER, SIDES
from pipeline.data.setup import Setup

if TYPE_CHECKING:
    from .robots.contract import Embodiment

OBSERVER_POSE = look((0.0, 0.85, 1.45), (0.0, -0.84, -0.54), (1.0, 0.0, 0.0))
OBSERVER_FOVY = 62.0
"""Degrees; the observer stands across the table."""


class CameraError(DominoError):
    """A camera that cannot be drawn from."""


def cameras_of(embodiment: "Embodiment", camera_type: str = "D435") -> tuple[Camera, ...]:
    """Head and wrist cameras. Raises KeyError for an unknown camera type."""
    kind = CAMERA_TYPES[camera_type]
    wrists = [
        Camera(CAMERAS[side], kind, f"{side}_{arm.camera.link}", arm.camera.pose)
        for side, arm in embodiment.arms.items()
    ]
    return (Camera(HEAD, kind, None, embodiment.head_camera), *wrists)


def observer(kind: CameraType) -> Camera:
    """The third-person camera, sized as `kind`."""
    return Camera(OBSERVER, replace(kind, fovy=OBSERVER_FOVY), None, OBSERVER_POSE)


def setup_cameras(embodiment: "Embodiment", setup: Setup) -> tuple[Camera, ...]:
    return wanted_cameras(cameras_of(embodiment, setup.camera), setup, embodiment.sides)


def wanted_cameras(
    mounted: Sequence[Camera], setup: Setup, sides: Collection[str] = SIDES
) -> tuple[Camera, ...]:
    """The cameras of a setup, in its order and size; none on an arm not in `sides`. They are
    `mounted`, stored, the observer or described by the setup. Raises CameraError for an unknown
    name."""
    known = {OBSERVER: observer(CAMERA_TYPES[setup.camera])} | {
        camera.name: camera for camera in mounted
    }
    cameras = []
    for each in setup.cameras:
        if each in SIDES and each not in sides:
            continue
        if isinstance(each, NamedCamera):
            cameras.append(each.camera(each.name))
        elif camera_name(each) in known:
            cameras.append(known[camera_name(each)])
        else:
            names = ", ".join(sorted(known))
            raise CameraError(f"there is no camera {each} to draw from: there are {names}")
    if setup.size is None:
        return tuple(cameras)
    width, height = setup.size
    return tuple(replace(c, type=replace(c.type, width=width, height=height)) for c in cameras)


def check_links(cameras: Sequence[Camera], bodies: Sequence[str]) -> None:
    """Raise CameraError for a camera on a missing link."""
    for camera in cameras:
        if camera.link is not None and camera.link not in bodies:
            known = ", ".join(bodies)
            raise CameraError(f"camera {camera.name} is on {camera.link!r}: bodies are {known}")

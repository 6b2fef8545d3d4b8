"""Cameras as data: types, mounts, matrices (OpenCV and OpenGL)."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.poses import Bools, Floats, Floats32, Pixels, Pose, compose, frame, inverse, matrix


@dataclass(frozen=True)
class CameraType:
    """Image size (pixels) and vertical field of view (degrees)."""

    width: int
    height: int
    fovy: float


CAMERA_TYPES = {
    "L515": CameraType(320, 180, 45.0),
    "Large_L515": CameraType(640, 360, 45.0),
    "D435": CameraType(320, 240, 37.0),
    "Large_D435": CameraType(640, 480, 37.0),
}


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera; `pose` (7,) is in `link`, or the world for None: x forward, y left, z up."""

    name: str
    type: CameraType
    link: str | None
    pose: Pose


def look(position: ArrayLike, forward: ArrayLike, left: ArrayLike = (-1, 0, 0)) -> Pose:
    """Pose at a position with this viewing direction, and its left about there."""
    return frame(position, forward, left)


def intrinsics(camera: CameraType) -> Floats:
    """Pinhole matrix (3,3) in pixels, principal point at the image centre."""
    f = camera.height / 2 / np.tan(np.radians(camera.fovy) / 2)
    return np.array([[f, 0, camera.width / 2], [0, f, camera.height / 2], [0, 0, 1]])


# columns: camera axes in the body convention (x forward, y left, z up)
_CV_IN_BODY = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
_GL_IN_BODY = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])


def extrinsics_cv(world_pose: ArrayLike) -> Floats:
    """World to camera matrices (...,3,4), OpenCV axes, from world poses (...,7)."""
    m = matrix(inverse(world_pose))[..., :3, :]
    return _CV_IN_BODY.T @ m


def cam2world_gl(world_pose: ArrayLike) -> Floats:
    """Camera to world matrices (...,4,4), OpenGL axes, from world poses (...,7)."""
    m = matrix(world_pose)
    m[..., :3, :3] = m[..., :3, :3] @ _GL_IN_BODY
    return m


@lru_cache(maxsize=64)
def _matrices(camera: CameraType, world_pose: bytes) -> tuple[Floats, Floats]:
    """Remembered extrinsics and intrinsics: evaluations ask every control period."""
    return extrinsics_cv(np.frombuffer(world_pose)), intrinsics(camera)


def project(camera: CameraType, world_pose: ArrayLike, points: ArrayLike) -> tuple[Floats, Floats]:
    """Pixels (...,2) of world points (...,3), and depth (...) m along the viewing axis."""
    e, k = _matrices(camera, np.asarray(world_pose, float).tobytes())
    p = np.asarray(points, float) @ e[:3, :3].T + e[:3, 3]
    uv = p @ k.T
    return uv[..., :2] / uv[..., 2:], p[..., 2]


def visible(
    camera: CameraType, world_pose: ArrayLike, points: ArrayLike, margin: float = 0.0
) -> Bools:
    """Which world points (...,3) are at least `margin` px inside the image."""
    uv, depth = project(camera, world_pose, points)
    if uv.ndim == 1:  # arrays of two numbers cost ten times as much
        u, v = uv.tolist()
        inside = margin <= u <= camera.width - margin and margin <= v <= camera.height - margin
        return np.asarray(inside and depth > 0.05)
    inside = ((uv >= margin) & (uv <= np.subtract((camera.width, camera.height), margin))).all(-1)
    return inside & (depth > 0.05)


def world_poses(camera: Camera, links: Mapping[str, Floats], frames: int) -> Floats:
    """World poses (T,7) of a camera, from poses (T,7) of `links` by name. Raises KeyError."""
    mount = np.asarray(camera.pose, float)
    if camera.link is None:
        return np.repeat(mount[None], frames, 0)
    return compose(links[camera.link], mount)


@dataclass(eq=False)
class View:
    """RGB (T,H,W,3), world poses (T,7), depth (T,H,W) mm, segmentation (T,H,W): body index + 1,
    0 = background.
    """

    camera: Camera
    poses: Floats
    rgb: Pixels
    depth: NDArray[np.uint16] | None = None
    segmentation: Pixels | None = None


@dataclass(eq=False)
class Surfaces:
    """What a camera looks at: world poses (T,7), depth (T,H,W) m (0: nothing), segmentation as
    in View, unit normals (T,H,W,3) in the camera frame, x right, y down, z forward.
    """

    camera: Camera
    poses: Floats
    depth: Floats32
    segmentation: Pixels
    normals: NDArray[np.float16]

"""The target's path ahead of every frame, in the world and in an image."""

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CameraType, extrinsics_cv, intrinsics
from pipeline.poses import Floats

NEAREST = 0.01  # m before a camera


def ahead(frames: int, horizon: int) -> NDArray[np.int64]:
    """Frames (T,H) t+1 to t+horizon, the last frame standing for those after it."""
    return np.minimum(np.arange(frames)[:, None] + np.arange(1, horizon + 1), frames - 1)


def path_ahead(positions: Floats, horizon: int) -> Floats:
    """Positions (T,H,3) in m of the next `horizon` frames."""
    return positions[ahead(len(positions), horizon)]


def trace_ahead(
    camera: CameraType, camera_poses: Floats, positions: Floats, horizon: int
) -> Floats:
    """Columns, rows (pixels) and depths (m) (T,H,3) of the next positions, zero less than 1 cm
    before the camera.
    """
    e = extrinsics_cv(camera_poses)
    seen = np.einsum("tij,thj->thi", e[..., :3], path_ahead(positions, horizon)) + e[:, None, :, 3]
    depth = seen[..., 2:]
    front = depth > NEAREST
    pixels = (seen @ intrinsics(camera).T)[..., :2] / np.where(front, depth, 1.0)
    return np.where(front, np.concatenate([pixels, depth], axis=-1), 0.0)

"""Which bodies a camera may see: bounds against the sides of its view."""

import numpy as np
from numpy.typing import NDArray

from pipeline.data.cameras import CameraType
from pipeline.poses import compose, inverse, quat_to_matrix

MARGIN = 1e-3  # m, far above the rounding of single precision


def in_view(
    kind: CameraType,
    camera: NDArray[np.float64],
    bodies: NDArray[np.float64],
    centres: NDArray[np.float64],
    halves: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether each of N bodies may be seen at each of T frames (T,N): never False for one with a
    pixel in the image.

    `camera` (T,7) and `bodies` (T,N,7) are world poses, the camera's with x forward, y left, z up;
    `centres` and `halves` (N,3) m are boxes in the body frames that contain the bodies.
    """
    high = np.tan(np.radians(kind.fovy) / 2)
    wide = high * kind.width / kind.height
    inward = np.array([[1, 0, 0], [wide, -1, 0], [wide, 1, 0], [high, 0, -1], [high, 0, 1]])
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    relative = compose(inverse(camera)[:, None], bodies)
    normals = inward @ quat_to_matrix(relative[..., 3:])  # (T,N,5,3), in the body frames
    middle = relative[..., :3] @ inward.T + np.einsum("tnsi,ni->tns", normals, centres)
    reach = np.einsum("tnsi,ni->tns", np.abs(normals), halves)
    return (middle + reach >= -MARGIN).all(-1)

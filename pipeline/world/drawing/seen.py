"""What a camera may see."""

import numpy as np

from pipeline.data.cameras import CameraType
from pipeline.poses import Bools, Floats, compose, inverse, quat_to_matrix

MARGIN = 1e-3  # m, far above the rounding of single precision
SAME_VIEW = 4  # frames that share a set of visible bodies


def in_view(
    kind: CameraType, camera: Floats, bodies: Floats, centres: Floats, halves: Floats
) -> Bools:
    """Whether each body may be seen (T,N): never False for one with a pixel. `camera` (T,7), x
    forward, and `bodies` (T,N,7) are world poses; `centres` and `halves` (N,3) m bound the bodies
    in their frames."""
    high = np.tan(np.radians(kind.fovy) / 2)
    wide = high * kind.width / kind.height
    inward = np.array([[1, 0, 0], [wide, -1, 0], [wide, 1, 0], [high, 0, -1], [high, 0, 1]])
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    relative = compose(inverse(camera)[:, None], bodies)
    normals = inward @ quat_to_matrix(relative[..., 3:])  # (T,N,5,3), in the body frames
    middle = relative[..., :3] @ inward.T + np.einsum("tnsi,ni->tns", normals, centres)
    reach = np.einsum("tnsi,ni->tns", np.abs(normals), halves)
    return (middle + reach >= -MARGIN).all(-1)


def visible_bodies(
    kind: CameraType, camera: Floats, bodies: Floats, boxes: tuple[Floats, Floats]
) -> Bools:
    """As `in_view`, the same (T,N) for SAME_VIEW frames in a row. `boxes` are middles and half
    sizes (N,3), m."""
    frames = np.arange(len(camera)) // SAME_VIEW
    alone = in_view(kind, camera, bodies, *boxes)
    return np.logical_or.reduceat(alone, np.arange(0, len(camera), SAME_VIEW))[frames]

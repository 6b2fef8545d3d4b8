"""What a camera may see, and which frames certainly repeat the one before."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.cameras import CameraType
from pipeline.poses import Bools, Floats, compose, inverse, quat_rotate, quat_to_matrix
from pipeline.world.physics.body import TABLE_THICKNESS, TABLE_TOP

from .engine import FAR, NEAR
from .masks import BLOCK, Blocks, Depths
from .sensing import rays
from .shadows import SHADOW_MAP, sun_map

MARGIN = 1e-3  # m, far above the rounding of single precision
SAME_VIEW = 4  # frames that share a set of visible bodies
STILL = 2.0**-50  # m, and of a quaternion in single precision: nothing beside what it adds to
TAPS = 4  # texels around a point of a surface that its shadow may be looked up from
NEAR_PLANE = 0.01  # m off table and floor, up to which a point may be theirs


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


class Seen:
    """What one camera sees. `camera` (T,7) and `bodies` (T,N,7) are world poses, `boxes` middles
    and half sizes (N,3), m, `visible` (T,N)."""

    def __init__(
        self,
        kind: CameraType,
        camera: Floats,
        bodies: Floats,
        boxes: tuple[Floats, Floats],
        sun: ArrayLike,
    ) -> None:
        self._kind, self._sun = kind, sun
        # as the engine takes them: images must be the same to the last bit
        self._camera = camera.astype(np.float32).astype(float)
        self._bodies = bodies.astype(np.float32).astype(float)
        frames = np.arange(len(camera)) // SAME_VIEW
        alone = in_view(kind, camera, bodies, *boxes)
        self.visible = np.logical_or.reduceat(alone, np.arange(0, len(camera), SAME_VIEW))[frames]
        self._since = 0  # the frame that what is in view has not moved since
        self._looked_up: Blocks | None = None

    def same(self, k: int, changed: Blocks, depths: Callable[[], Depths] | None) -> bool:
        """Whether frame `k` certainly equals the one before, given `changed` shadows and that one's
        depth buffer. Ask for all frames in order."""
        j = self._since
        bodies = self.visible[j] | self.visible[k]
        if (
            k == 0
            or np.abs(self._camera[k] - self._camera[j]).max() > STILL
            or np.abs(self._bodies[k, bodies] - self._bodies[j, bodies]).max(initial=0) > STILL
        ):
            self._since, self._looked_up = k, None
            return False
        if not changed.any() or depths is None:
            return not changed.any()
        if self._looked_up is None:
            self._looked_up = looked_up(self._kind, self._camera[j], depths(), self._sun)
        return not (changed & self._looked_up).any()


def looked_up(kind: CameraType, camera: Floats, depths: Depths, sun: ArrayLike) -> Blocks:
    """Blocks (3,M,M) of the maps that an image from the pose `camera` (7,), with depth buffer (H,W)
    0-1, was shaded from."""
    forward = NEAR * FAR / (FAR - depths * (FAR - NEAR))
    at = quat_rotate(camera[3:], rays(kind) * forward[..., None]) + camera[:3]
    height, move = at[..., 2], sun_map(sun)[:2]
    column, row = np.moveaxis(np.floor(at @ move[:, :3].T + move[:, 3]).astype(int), -1, 0)
    inside = (column >= 0) & (row >= 0) & (column < SHADOW_MAP) & (row < SHADOW_MAP)
    table = height < TABLE_TOP + NEAR_PLANE
    table &= height > TABLE_TOP - TABLE_THICKNESS - NEAR_PLANE
    count, wide = SHADOW_MAP // BLOCK, np.ones((2 * TAPS + 1, 2 * TAPS + 1), np.uint8)
    found = np.zeros((3, SHADOW_MAP, SHADOW_MAP), np.uint8)
    for texels, those in zip(found, (table, height < NEAR_PLANE, True), strict=True):
        texels[row[inside & those], column[inside & those]] = 1
    return np.stack(
        [
            cv2.dilate(texels, wide).reshape(count, BLOCK, count, BLOCK).any((1, 3))
            for texels in found
        ]
    )

"""Shares of light on the planes that shadows fall on, from the sun's shadow map: hard for the first
look, soft for today's."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

Depths = NDArray[np.float32]
Masks = NDArray[np.uint8]

# texels, odd: widths of a shadow's edge where its body is near the plane, farther off, and far off
NEAR, MIDDLE, FAR = 3, 11, 25
SOFTEST = 0.40  # m between body and plane, at which an edge is as wide as FAR
CONTACT = 0.05  # m above the table, up to which a body takes the room's light from it
# texels, odd: the dark line where a body meets the table, and the wide shade around it
CONTACT_WIDTHS = (7, 21)
# m: the far side of a body that lies on the table is up to so much under the plane that light is
# looked up on
BELOW = 0.009
DARKEST = 0.85  # share of the room's light that goes below a body which lies on the table


@dataclass(frozen=True, eq=False)
class Ground:
    """What shadows fall on: depths (N,N) of `table` and `floor` in the map, 0-1 over `depth`
    (m). `window` are the rows and columns of the table and FAR // 2 texels around it."""

    table: Depths
    floor: Depths
    depth: float
    window: tuple[slice, slice]

    @cached_property
    def inside(self) -> Depths:
        return np.ascontiguousarray(self.table[self.window])


def hard(depths: Depths, ground: Ground) -> Masks:
    """Share of the sun's light, 0-255, on table and floor (N,N,2), averaged over 3x3 texels."""
    return np.dstack([_bordered(_lit(depths, plane, 3)) for plane in (ground.table, ground.floor)])


def soft(depths: Depths, ground: Ground) -> Masks:
    """Masks (N,N,4), 0-255: the sun's light on the table, on the floor, the room's light on the
    table, and 255. Edges of shadows widen with the distance between body and table."""
    inside = np.ascontiguousarray(depths[ground.window])
    blocked, height, contact = np.empty((3, *inside.shape), np.uint8)
    _above(inside, ground.inside, ground.depth, (blocked, height, contact))
    shadows = (_blurred(blocked, NEAR), _blurred(blocked, MIDDLE), _blurred(blocked, FAR))
    height, line, wide = (
        _blurred(height, FAR),
        *(_blurred(contact, width) for width in CONTACT_WIDTHS),
    )
    full = np.full(depths.shape, 255, np.uint8)
    masks = np.asarray(cv2.merge((full, _lit(depths, ground.floor, MIDDLE), full, full)), np.uint8)
    _mix(shadows, height, (line, wide), masks[ground.window])
    return _bordered(masks)


@njit(cache=True, error_model="numpy")
def _above(depths: Depths, table: Depths, depth: float, out: tuple[Masks, Masks, Masks]) -> None:
    """For every texel, 0-255: whether a body is in the sun's way to the table, how high, and
    what it takes of the room's light."""
    blocked, height, contact = out
    scale, close, below = (
        np.float32(depth * 255 / SOFTEST),
        np.float32(depth / CONTACT),
        np.float32(-BELOW / depth),
    )
    for y in range(depths.shape[0]):
        for x in range(depths.shape[1]):
            gap = table[y, x] - depths[y, x]
            blocked[y, x] = 255 if gap > below else 0
            height[y, x] = min(max(gap * scale, np.float32(0)), np.float32(255))
            near = max(np.float32(1) - max(gap, np.float32(0)) * close, np.float32(0)) * np.float32(
                255 * DARKEST
            )
            contact[y, x] = near if gap > below else 0


@njit(cache=True, error_model="numpy")
def _mix(
    shadows: tuple[Masks, Masks, Masks], height: Masks, contact: tuple[Masks, Masks], out: Masks
) -> None:
    """The table's channels; the shadow is mixed of three by the mean height of bodies around a
    texel."""
    near, middle, far = shadows
    line, wide = contact
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            around = np.int32(far[y, x])
            if around > 0:
                low = min(np.int32(height[y, x]) * 510 // around, 510)
                high = max(low - 255, 0)
                low = min(low, 255)
                shadow = (near[y, x] * (255 - low) + middle[y, x] * low) // 255
                out[y, x, 0] = 255 - (shadow * (255 - high) + around * high) // 255
            out[y, x, 2] = 255 - min(np.int32(line[y, x]) * 3 // 4 + np.int32(wide[y, x]) // 2, 255)


def _lit(depths: Depths, plane: Depths, width: int) -> Masks:
    return _blurred(np.asarray(cv2.compare(depths, plane, cv2.CMP_GE), np.uint8), width)


def _blurred(image: Masks, width: int) -> Masks:
    return np.asarray(cv2.blur(image, (width, width)), np.uint8)


def _bordered(light: Masks) -> Masks:
    """Light whose border is lit: what is outside of the map looks up the border."""
    light[:2], light[-2:], light[:, :2], light[:, -2:] = 255, 255, 255, 255
    return light

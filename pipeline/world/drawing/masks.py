"""Masks of the light that a depth map leaves on table and floor."""

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.poses import Bools, Floats32, Pixels

from .compiled import compiled

Depths = Floats32
Masks = Pixels
Blocks = Bools
Area = tuple[slice, slice]
ALL: Area = (slice(None), slice(None))
BLOCK = 8  # texels a side of what changes between frames are told by

# texels, odd: widths of a shadow's edge by the distance of its body from the plane
NEAR, MIDDLE, FAR = 3, 11, 25
SOFTEST = 0.40  # m between body and plane, at which an edge is as wide as FAR
CONTACT = 0.05  # m above the table, up to which a body takes the room's light from it
# texels, odd: the dark line where a body meets the table, and the wide shade around it
CONTACT_WIDTHS = (7, 21)
BELOW = 0.009  # m that the far side of a body on the table may be under the plane looked up
DARKEST = 0.85  # share of the room's light that goes below a body which lies on the table


@dataclass(frozen=True, eq=False)
class Ground:
    """Depths (N,N) of `table` and `floor`, 0-1 over `depth` (m). `window` are rows and columns of
    the table and FAR // 2 texels around."""

    table: Depths
    floor: Depths
    depth: float
    window: Area


def hard(depths: Depths, ground: Ground, masks: Masks | None = None, area: Area = ALL) -> Masks:
    """Sunlight 0-255 on table and floor (N,N,2), averaged over 3x3 texels. Given `masks` are
    updated where depths changed in `area`."""
    masks = np.full((*depths.shape, 2), 255, np.uint8) if masks is None else masks
    for channel, plane in enumerate((ground.table, ground.floor)):
        _light(depths, plane, 3, masks, channel, known(area, depths.shape))
    return _bordered(masks)


def soft(depths: Depths, ground: Ground, masks: Masks | None = None, area: Area = ALL) -> Masks:
    """Masks (N,N,4), 0-255: sunlight on table and floor, room light on the table, 255; otherwise as
    `hard`. Shadow edges widen with height over the table."""
    masks = np.full((*depths.shape, 4), 255, np.uint8) if masks is None else masks
    area, window = (known(part, depths.shape) for part in (area, ground.window))
    _light(depths, ground.floor, MIDDLE, masks, 1, area)
    part = grown(area, FAR // 2, window)
    if part[0].start >= part[0].stop or part[1].start >= part[1].stop:
        return _bordered(masks)
    source = grown(part, FAR // 2, window)
    inside, table = (np.ascontiguousarray(of[source]) for of in (depths, ground.table))
    blocked, height, contact = np.empty((3, *inside.shape), np.uint8)
    _above(inside, table, ground.depth, (blocked, height, contact))
    at = _within(part, source)
    near, middle, far = (_blurred(blocked, width)[at] for width in (NEAR, MIDDLE, FAR))
    line, wide = (_blurred(contact, width)[at] for width in CONTACT_WIDTHS)
    _mix((near, middle, far), _blurred(height, FAR)[at], (line, wide), masks[part])
    return _bordered(masks)


def _light(
    depths: Depths, plane: Depths, width: int, masks: Masks, channel: int, area: Area
) -> None:
    whole = known(ALL, depths.shape)
    part = grown(area, width // 2, whole)
    source = grown(part, width // 2, whole)
    lit = np.asarray(cv2.compare(depths[source], plane[source], cv2.CMP_GE), np.uint8)
    masks[part][..., channel] = _blurred(lit, width)[_within(part, source)]


def known(area: Area, shape: tuple[int, ...]) -> Area:
    rows, columns = (slice(*part.indices(n)[:2]) for part, n in zip(area, shape, strict=True))
    return rows, columns


def grown(area: Area, by: int, limits: Area) -> Area:
    """The area and `by` texels around it, within limits."""
    rows, columns = (
        slice(max(part.start - by, limit.start), min(part.stop + by, limit.stop))
        for part, limit in zip(area, limits, strict=True)
    )
    return rows, columns


def _within(part: Area, source: Area) -> Area:
    rows, columns = (
        slice(a.start - b.start, a.stop - b.start) for a, b in zip(part, source, strict=True)
    )
    return rows, columns


@compiled
def _above(depths: Depths, table: Depths, depth: float, out: tuple[Masks, Masks, Masks]) -> None:
    """For every texel, 0-255: whether a body blocks the sun, its height, and the room light it
    takes."""
    blocked, height, contact = out
    scale, close = np.float32(depth * 255 / SOFTEST), np.float32(depth / CONTACT)
    below = np.float32(-BELOW / depth)
    for y in range(depths.shape[0]):
        for x in range(depths.shape[1]):
            gap = table[y, x] - depths[y, x]
            blocked[y, x] = 255 if gap > below else 0
            height[y, x] = min(max(gap * scale, np.float32(0)), np.float32(255))
            near = max(np.float32(1) - max(gap, np.float32(0)) * close, np.float32(0))
            contact[y, x] = near * np.float32(255 * DARKEST) if gap > below else 0


@compiled
def _mix(
    shadows: tuple[Masks, Masks, Masks], height: Masks, contact: tuple[Masks, Masks], out: Masks
) -> None:
    """The table's channels: three shadows mixed by the mean height of bodies around."""
    near, middle, far = shadows
    line, wide = contact
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            around = np.int32(far[y, x])
            out[y, x, 0] = 255
            if around > 0:
                low = min(np.int32(height[y, x]) * 510 // around, 510)
                high = max(low - 255, 0)
                low = min(low, 255)
                shadow = (near[y, x] * (255 - low) + middle[y, x] * low) // 255
                out[y, x, 0] = 255 - (shadow * (255 - high) + around * high) // 255
            out[y, x, 2] = 255 - min(np.int32(line[y, x]) * 3 // 4 + np.int32(wide[y, x]) // 2, 255)


def _blurred(image: Masks, width: int) -> Masks:
    return np.asarray(cv2.blur(image, (width, width)), np.uint8)


def _bordered(light: Masks) -> Masks:
    """Light with a lit border, looked up outside of the map."""
    light[:2], light[-2:], light[:, :2], light[:, -2:] = 255, 255, 255, 255
    return light


@compiled
def compare(
    different: Bools, before: Masks, now: Masks, corner: tuple[int, int], out: Blocks
) -> None:
    """Blocks (3,M,M) of changed light on table, on floor, and changed depths; `before` starts at
    `corner`."""
    for i in range(before.shape[0]):
        y = corner[0] + i
        for j in range(before.shape[1]):
            x = corner[1] + j
            if different[y, x]:
                out[2, y // BLOCK, x // BLOCK] = True
            for channel in range(before.shape[2]):
                if before[i, j, channel] != now[y, x, channel]:
                    out[channel & 1, y // BLOCK, x // BLOCK] = True

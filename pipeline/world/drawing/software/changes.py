"""Which pixels must be shaded again, and where shadows need no look-up."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Bools, Floats32, Ints

from .kernels import kernel
from .light import NEAREST
from .raster import Frame, Ids

AROUND = np.ones((3, 3), np.uint8)


class Stale(NamedTuple):
    """What must be shaded again: everything, or pixels that show another surface than `before`,
    bodies that `moved`, and what is lit from blocks of the maps that `changed` (3,B)."""

    everything: bool
    before: Ids
    moved: Bools
    changed: Bools


@kernel
def sort_stale(
    frame: Frame,
    stale: Stale,
    blocks: NDArray[np.uint16],
    body: NDArray[np.uint16],
    planes: Floats32,
    out: Ids,
) -> Ints:
    """Pixels to be shaded into `out` (2+Q,H*W), by what they show: nothing, bodies, each plane.
    Their numbers (2+Q,)."""
    ids, before, every = frame.ids, stale.before, stale.everything
    counts = np.empty(len(planes) + 2, np.int64)
    channels = np.empty(len(planes) + 2, np.int64)
    for k in range(len(planes) + 2):
        counts[k], channels[k] = 0, 2 if k == 1 else -1
        if k > 1 and planes[k - 2, 16] < 2:
            channels[k] = int(planes[k - 2, 16])
    for p in range(len(ids)):
        t = ids[p]
        group = 1 if t >= 0 else -t if t < -1 else 0
        shaded = not every and t == before[p] and (t < 0 or not stale.moved[body[t]])
        if shaded and (channels[group] < 0 or not stale.changed[channels[group], blocks[p]]):
            continue
        out[group, counts[group]] = p
        counts[group] += 1
    return counts


def surrounding(depths: Floats32, least: Floats32, most: Floats32) -> None:
    """Least and most depth in each 4 x 4 texels and those around them."""
    _extremes(depths, least, most)
    cv2.erode(least, AROUND, dst=least)
    cv2.dilate(most, AROUND, dst=most)


@kernel
def _extremes(depths: Floats32, least: Floats32, most: Floats32) -> None:
    n = least.shape[0]
    near, far = np.empty(NEAREST * n, np.float32), np.empty(NEAREST * n, np.float32)
    for y in range(n):
        row = depths[NEAREST * y]
        for x in range(NEAREST * n):  # an assignment to near[:] takes two seconds to compile
            near[x], far[x] = row[x], row[x]
        for i in range(NEAREST * y + 1, NEAREST * (y + 1)):
            row = depths[i]
            for x in range(NEAREST * n):
                near[x], far[x] = min(near[x], row[x]), max(far[x], row[x])
        for x in range(n):
            low, high = near[NEAREST * x], far[NEAREST * x]
            for j in range(NEAREST * x + 1, NEAREST * (x + 1)):
                low, high = min(low, near[j]), max(high, far[j])
            least[y, x], most[y, x] = low, high

"""Smooth edges of an image of one sample a pixel, after FXAA (Lottes, 2009), in integers."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Pixels

from .compiled import compiled

LEAST = 32  # smallest step of brightness, 0-255, that counts as an edge
SHARE = 8  # and the edge is at least a so-manieth of the brightest pixel around
FARTHEST = 8  # pixels an edge is followed to both sides
LENS = 6  # shares of its own light that a pixel keeps, of two more that it gets along each axis

CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


def smoothed(image: Pixels, out: Pixels) -> None:
    """Blend the jagged edges of `image` (H,W,4) to `out` (H,W,3): a pixel takes a share of the one
    across, by its place along the edge."""
    cv2.cvtColor(image, cv2.COLOR_RGBA2RGB, dst=out)
    luma = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGBA2GRAY), np.uint8)
    brightest = np.asarray(cv2.dilate(luma, CROSS), np.uint8)
    step = brightest - np.asarray(cv2.erode(luma, CROSS), np.uint8)
    edge = np.zeros((image.shape[0], -(-image.shape[1] // 8) * 8), np.uint8)
    edge[1:-1, 1 : image.shape[1] - 1] = ((step >= LEAST) & (step >= brightest // SHARE))[
        1:-1, 1:-1
    ]
    _blend(image, luma, step, (edge, edge.view(np.uint64)), out)


@compiled
def through_lens(image: Pixels, out: Pixels) -> None:
    """Spread each pixel's light a little, from `image` (H,W,3) to `out`."""
    height, width = image.shape[0], 3 * image.shape[1]
    rows, spread = image.reshape(height, width), out.reshape(height, width)
    column = np.empty(width + 6, np.uint16)
    own, half = np.uint16(LENS), np.uint16((LENS + 2) ** 2 // 2)
    for y in range(height):
        above, row, below = rows[max(y - 1, 0)], rows[y], rows[min(y + 1, height - 1)]
        for x in range(width):
            column[x + 3] = np.uint16(above[x]) + np.uint16(below[x]) + own * np.uint16(row[x])
        for c in range(3):
            column[c], column[width + 3 + c] = column[c + 3], column[width + c]
        for x in range(width):
            spread[y, x] = np.uint16(
                column[x] + column[x + 6] + own * column[x + 3] + half
            ) // np.uint16((LENS + 2) ** 2)


@compiled
def _blend(
    image: Pixels,
    luma: Pixels,
    steps: Pixels,
    edges: tuple[Pixels, NDArray[np.uint64]],
    out: Pixels,
) -> None:
    """Blend pixels where the first of `edges` is not 0; the second is the same in words of
    eight."""
    height, width = luma.shape
    edge, words = edges
    flat = luma.ravel()
    for y in range(1, height - 1):
        for word in range(words.shape[1]):
            if words[y, word] == 0:
                continue
            for x in range(8 * word, 8 * word + 8):
                if edge[y, x] == 0:
                    continue
                p = y * width + x
                m, step = np.int32(flat[p]), np.int32(steps[y, x])
                n, s = np.int32(flat[p - width]), np.int32(flat[p + width])
                w, e = np.int32(flat[p - 1]), np.int32(flat[p + 1])
                nw, ne = np.int32(flat[p - width - 1]), np.int32(flat[p - width + 1])
                sw, se = np.int32(flat[p + width - 1]), np.int32(flat[p + width + 1])
                down = 2 * abs(n + s - 2 * m) + abs(ne + se - 2 * e) + abs(nw + sw - 2 * w)
                across = 2 * abs(w + e - 2 * m) + abs(nw + ne - 2 * n) + abs(sw + se - 2 * s)
                level = down >= across  # the edge runs from left to right
                one, two = (n, s) if level else (w, e)
                first = abs(one - m) >= abs(two - m)
                other = one if first else two
                slope = abs(other - m)
                side = (-width if first else width) if level else (-1 if first else 1)
                middle = m + other  # twice the brightness on the edge
                below = 2 * m < middle
                stride, before = (1, x - 1) if level else (width, y - 1)
                after = width - 2 - x if level else height - 2 - y
                across_it = (side, middle, slope)
                back, back_end = _end(flat, p, -stride, min(before, FARTHEST), across_it)
                ahead, ahead_end = _end(flat, p, stride, min(after, FARTHEST), across_it)
                near_end = back_end if back <= ahead else ahead_end
                share = 0
                if near_end != 0 and (near_end < 0) != below:
                    share = 128 - 256 * min(back, ahead) // (back + ahead)
                mean = (2 * (n + s + w + e) + nw + ne + sw + se) // 12
                corner = min(256 * abs(mean - m) // max(step, 1), 256)
                share = max(share, corner * corner // 512)
                oy, ox = (-1 if first else 1, 0) if level else (0, -1 if first else 1)
                for c in range(3):
                    out[y, x, c] = (
                        image[y, x, c] * (256 - share) + image[y + oy, x + ox, c] * share + 128
                    ) >> 8


@compiled
def _end(
    luma: Pixels, p: int, stride: int, steps: int, edge: tuple[int, np.int32, np.int32]
) -> tuple[int, np.int32]:
    """Steps of `stride` to an edge's end, at most `steps`, and its brightness difference (0:
    unknown). `edge` is the offset across, twice its brightness, and the slope."""
    side, middle, slope = edge
    for k in range(1, steps + 1):
        p += stride
        off = np.int32(luma[p]) + np.int32(luma[p + side]) - middle
        if abs(off) * 2 >= slope:
            return k, off
    return min(steps + 1, FARTHEST), np.int32(0)

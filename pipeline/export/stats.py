"""Exact statistics in the form LeRobot stores them: min, max, mean, std, count and the quantiles q01 q10 q50 q90 q99.

LeRobot estimates quantiles from histograms of 5,000 bins and, over a dataset, as means of the episodes' quantiles. These are
computed from all values: the smallest value x with F(x) >= q, which is what its histogram approximates.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.export.video import samples

TOGETHER = 8
"""Frames whose colors are counted at once: few enough for the cache of a core."""

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
Stats = dict[str, NDArray[Any]]


def vector_stats(values: NDArray[Any]) -> Stats:
    """Statistics of (N,) or (N,d) values over N; each entry has shape (1,) or (d,)."""
    columns = values.reshape(len(values), -1).T
    quantiles = np.stack([np.quantile(c, QUANTILES, method="inverted_cdf") for c in columns], axis=1)
    return {
        "min": columns.min(1),
        "max": columns.max(1),
        "mean": columns.mean(1, dtype=np.float64),
        "std": np.array([c.std(dtype=np.float64) for c in columns]),
        "count": np.array([len(values)]),
        **{f"q{round(100 * q):02d}": row for q, row in zip(QUANTILES, quantiles, strict=True)},
    }


def sample_rows(length: int) -> NDArray[np.int64]:
    """Frames that enter the image statistics, LeRobot's rule: max(min(100, N), min(N^0.75, 10000)) evenly spaced ones."""
    count = max(min(100, length), min(int(length**0.75), 10_000))
    return np.round(np.linspace(0, length - 1, count)).astype(np.int64)


def color_counts(frames: Sequence[NDArray[np.uint8]]) -> NDArray[np.int64]:
    """How often each value occurs, (3,256), in images (H,W,3); large ones are thinned to about 150 pixels, LeRobot's rule."""
    step = _step(*frames[0].shape[:2])
    return sum((_counts(f[::step, ::step]) for f in frames), np.zeros((3, 256), np.int64))


def plane_counts(frames: Sequence[Any]) -> NDArray[np.int64]:
    """`color_counts` of frames of `video.decoded_planes`, RGB being made of the pixels that count only.

    Where pixels are thinned, one has the chroma of its 2 by 2 block, as in what readers of the video get.
    """
    first = frames[0]
    step = _step(first.height, first.width)
    if first.format.name != "yuvj420p" or first.width % step or first.height % step:
        return color_counts([frame.to_ndarray(format="rgb24") for frame in frames])
    counts, (width, height) = np.zeros((3, 256), np.int64), (first.width // step, first.height // step)
    for at in range(0, len(frames), TOGETHER):
        some = frames[at : at + TOGETHER]
        thin: Any = np.empty((len(some), height, width, 3), np.uint8)
        for frame, pixels in zip(some, thin, strict=True):
            luma, blue, red = (samples(plane) for plane in frame.planes)
            cv2.merge([cv2.resize(plane, (width, height), interpolation=cv2.INTER_NEAREST) for plane in (luma, red, blue)], pixels)
        # the range is the full one of a JPEG
        counts += _counts(cv2.cvtColor(thin.reshape(-1, width, 3), cv2.COLOR_YCrCb2RGB))
    return counts


def _step(height: int, width: int) -> int:
    return 1 if max(height, width) < 300 else int((width if width > height else height) / 150)


def _counts(rgb: Any) -> NDArray[np.int64]:
    rgb = np.ascontiguousarray(rgb)
    return np.stack([cv2.calcHist([rgb], [c], None, [256], [0, 256])[:, 0] for c in range(3)]).astype(np.int64)


def image_stats(counts: NDArray[np.int64], frames: int) -> Stats:
    """Statistics (3,1,1) of colours in 0-1 from counts (3,256); `count` is the number of images, as LeRobot has it."""
    values = np.arange(256) / 255.0
    total = counts.sum(1)
    mean = counts @ values / total
    present = counts > 0
    below = np.cumsum(counts, axis=1)
    out = {
        "min": values[present.argmax(1)],
        "max": values[255 - present[:, ::-1].argmax(1)],
        "mean": mean,
        "std": np.sqrt(np.maximum(counts @ values**2 / total - mean**2, 0.0)),
    }
    for q in QUANTILES:
        out[f"q{round(100 * q):02d}"] = values[(below >= q * total[:, None]).argmax(1)]
    return {**{k: v.reshape(3, 1, 1) for k, v in out.items()}, "count": np.array([frames])}

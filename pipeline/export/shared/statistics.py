"""Exact statistics in LeRobot's form; quantiles are the smallest x with F(x) >= q."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Ints, Pixels

from .video import samples

TOGETHER = 8
"""Frames whose colors are counted at once: few enough for the cache of a core."""

PERCENTILES = (1, 10, 50, 90, 99)
Stats = dict[str, NDArray[Any]]


def vector_stats(values: NDArray[Any]) -> Stats:
    """Statistics of (N,) or (N,d) values over N."""
    columns = np.ascontiguousarray(values.reshape(len(values), -1).T)
    rising, count = np.sort(columns, axis=1), len(values)
    return {
        "min": rising[:, 0],
        "max": rising[:, -1],
        "mean": columns.mean(1, dtype=np.float64),
        "std": columns.std(1, dtype=np.float64),
        "count": np.array([count]),
        **{f"q{percent:02d}": rising[:, -(-count * percent // 100) - 1] for percent in PERCENTILES},
    }


def sample_rows(length: int) -> Ints:
    """LeRobot's rule for image statistics: max(min(100, N), min(N^0.75, 10000))."""
    count = max(min(100, length), min(int(length**0.75), 10_000))
    return np.round(np.linspace(0, length - 1, count)).astype(np.int64)


def color_counts(frames: Sequence[Pixels]) -> Ints:
    """Counts (3,256) in images (H,W,3), thinned to about 150 pixels as LeRobot does."""
    step = _thinning(*frames[0].shape[:2])
    return sum((_counts(f[::step, ::step]) for f in frames), np.zeros((3, 256), np.int64))


class PlaneCounts:
    """Counts colors as `color_counts` does, of `video.decoded_planes`, in batches."""

    def __init__(self) -> None:
        self._counts, self._waiting = np.zeros((3, 256), np.int64), list[tuple[Any, Any, Any]]()
        self._step = 1

    def passing(self, frames: Iterable[Any], rows: Collection[int]) -> Iterator[Any]:
        """The frames; those numbered `rows` are counted."""
        for number, frame in enumerate(frames):
            if number in rows:
                self._add(frame)
            yield frame

    def counts(self) -> Ints:
        self._count()
        return self._counts

    def _add(self, frame: Any) -> None:
        self._step = step = _thinning(frame.height, frame.width)
        if frame.format.name != "yuvj420p" or frame.width % (2 * step) or frame.height % (2 * step):
            self._counts += color_counts([frame.to_ndarray(format="rgb24", src_color_range="JPEG")])
            return
        luma, blue, red = (samples(plane) for plane in frame.planes)
        self._waiting.append((_thin(luma, step), _spread(red, step), _spread(blue, step)))
        if len(self._waiting) == TOGETHER:
            self._count()

    def _count(self) -> None:
        if not self._waiting:
            return
        luma, *chroma = (np.stack(planes) for planes in zip(*self._waiting, strict=True))
        self._waiting.clear()
        every = (luma, *(_at_pixels(plane, self._step) for plane in chroma))
        planes: Any = [plane.reshape(-1, luma.shape[2]) for plane in every]
        # the range is the full one of a JPEG
        self._counts += _counts(cv2.cvtColor(cv2.merge(planes), cv2.COLOR_YCrCb2RGB))


def _spread(chroma: Any, step: int) -> Any:
    """Chroma (h,w) as libjpeg interpolates; for an even `step` the input (h+1,w+1) of
    `_at_pixels`."""
    if step % 2:
        return _thin(cv2.resize(chroma, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR), step)
    return cv2.copyMakeBorder(chroma, 1, 0, 1, 0, cv2.BORDER_REPLICATE)


def _at_pixels(spread: Pixels, step: int) -> Pixels:
    """For an even `step` the upper left of blocks of 2 by 2."""
    if step % 2:
        return spread
    flat: Any = spread.reshape(-1, spread.shape[2])
    across: Any = cv2.addWeighted(flat[:, 1:], 0.75, flat[:, :-1], 0.25, 0)
    across = across.reshape(*spread.shape[:2], -1)
    pixels = cv2.addWeighted(across[:, 1:], 0.75, across[:, :-1], 0.25, 0)
    return pixels[:, :: step // 2, :: step // 2]


def _thin(plane: Pixels, step: int) -> Pixels:
    if step not in (2, 4, 8):
        return plane[::step, ::step].copy()
    # the low byte of an integer: many at a time
    return plane[::step].view(f"<u{step}").astype(np.uint8)


def _thinning(height: int, width: int) -> int:
    return 1 if max(height, width) < 300 else int((width if width > height else height) / 150)


def _counts(rgb: Any) -> Ints:
    rgb = np.ascontiguousarray(rgb)
    channels = [cv2.calcHist([rgb], [c], None, [256], [0, 256])[:, 0] for c in range(3)]
    return np.stack(channels).astype(np.int64)


def image_stats(counts: Ints, frames: int) -> Stats:
    """Statistics (3,1,1) of colors in 0-1 from counts (3,256); `count` is of images."""
    values, total = np.arange(256) / 255.0, counts.sum(1)
    mean, present, below = counts @ values / total, counts > 0, np.cumsum(counts, axis=1)
    stats = {
        "min": values[present.argmax(1)],
        "max": values[255 - present[:, ::-1].argmax(1)],
        "mean": mean,
        "std": np.sqrt(np.maximum(counts @ values**2 / total - mean**2, 0.0)),
    }
    for percent in PERCENTILES:
        stats[f"q{percent:02d}"] = values[(100 * below >= percent * total[:, None]).argmax(1)]
    return {**{k: v.reshape(-1, 1, 1) for k, v in stats.items()}, "count": np.array([frames])}

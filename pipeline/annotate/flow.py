"""Optical flow between frames, drawn as in the paper's appendix. Row t holds the frames (max(0, t -
stride), t).

OpenCV's fused multiply-add changes Farneback's last bits between CPUs; `bit_stable` avoids it.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Floats32, Pixels

_LOCK = threading.RLock()


@contextmanager
def bit_stable() -> Iterator[None]:
    """OpenCV's baseline kernels and one thread; the settings are the process's, so that threads
    take turns."""
    with _LOCK:
        before = cv2.useOptimized(), cv2.getNumThreads(), cv2.ipp.useIPP()
        cv2.setUseOptimized(False)
        cv2.setNumThreads(1)
        try:
            yield
        finally:
            cv2.setUseOptimized(before[0])
            cv2.setNumThreads(before[1])
            cv2.ipp.setUseIPP(before[2])


@dataclass(frozen=True)
class Farneback:
    """Parameters of cv2.calcOpticalFlowFarneback, with the original's values."""

    pyr_scale: float = 0.5
    levels: int = 3
    winsize: int = 15
    iterations: int = 3
    poly_n: int = 5
    poly_sigma: float = 1.2


@dataclass(frozen=True)
class Colour:
    """Brightness is full at a percentile of each map (`per_map`, the paper's), of all
    (`shared`), or at `full_scale` px (`fixed`).
    """

    normalisation: Literal["per_map", "shared", "fixed"] = "per_map"
    percentile: float = 99.0
    threshold: float = 1e-6
    full_scale: float = 2.0


def previous_frames(frames: int, stride: int) -> NDArray[np.int32]:
    """Index (T,) of the frame that each frame is paired with."""
    return np.maximum(np.arange(frames) - stride, 0).astype(np.int32)


def shrink_grey(rgb: Pixels, size: tuple[int, int]) -> Pixels:
    """(H,W,3) uint8 RGB as (h,w) uint8 BT.601 luma, by area average; `size` = (width, height)."""
    with bit_stable():
        if rgb.shape[1::-1] != size:
            rgb = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
        return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)


def farneback(before: Pixels, after: Pixels, options: Farneback) -> Floats32:
    """Flow (h,w,2) px, x right and y down, between grey images (h,w) uint8."""
    flow = np.zeros((*before.shape, 2), np.float32)
    with bit_stable():
        made = cv2.calcOpticalFlowFarneback(before, after, flow, **vars(options), flags=0)
    return np.asarray(made, np.float32)


def flow_of(grey: Pixels, stride: int, options: Farneback) -> Floats32:
    """Flow (T,h,w,2) px of grey frames (T,h,w), each pair computed once."""
    flow = np.zeros((*grey.shape, 2), np.float32)
    for t, before in enumerate(previous_frames(len(grey), stride)):
        if before != t:
            flow[t] = farneback(grey[before], grey[t], options)
    return flow


def colour_flow(flow: NDArray[np.floating], options: Colour) -> tuple[Pixels, Floats32]:
    """RGB maps (N,h,w,3) of flows (N,h,w,2) px, and their full scale (N,) px. Hue is direction:
    0 right, 90 degrees down.
    """
    flow = np.ascontiguousarray(flow, np.float32)
    rgb = np.empty((*flow.shape[:3], 3), np.uint8)
    with bit_stable():
        polar = [cv2.cartToPolar(f[..., 0], f[..., 1], angleInDegrees=True) for f in flow]
        scale = _scales([np.asarray(m) for m, _ in polar], options)
        hsv = np.full((*flow.shape[1:3], 3), 255, np.uint8)
        for t, (magnitude, angle) in enumerate(polar):
            hsv[..., 0] = (np.asarray(angle) / 2).astype(np.uint8) % 180
            hsv[..., 2] = np.clip(magnitude / scale[t] * 255, 0, 255) if scale[t] > 0 else 0
            rgb[t] = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)
    return rgb, scale


def _scales(magnitudes: list[Floats32], options: Colour) -> Floats32:
    if options.normalisation == "shared" and magnitudes:
        shared = _percentile(np.stack(magnitudes), options.percentile)
        scale = np.full(len(magnitudes), shared, np.float32)
    else:
        scale = np.array([_percentile(m, options.percentile) for m in magnitudes], np.float32)
    still = scale < options.threshold
    if options.normalisation == "fixed":
        scale[:] = options.full_scale
    scale[still] = 0
    return scale


def _percentile(values: Floats32, percentile: float) -> float:
    """np.percentile by partial sort, ten times faster on small maps."""
    flat = values.ravel()
    place = percentile / 100 * (flat.size - 1)
    low = min(int(place), flat.size - 1)
    high = min(low + 1, flat.size - 1)
    part = np.partition(flat, (low, high))
    return float(part[low]) + (float(part[high]) - float(part[low])) * (place - low)

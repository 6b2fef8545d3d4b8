"""Past images as StarVLA's client sends them, or optical flow."""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.evaluate.policies.fit import scaled
from pipeline.poses import Pixels

Image = Pixels

CLOCK_TOLERANCE = 1e-3  # s


@dataclass(frozen=True)
class HistorySettings:
    """`length` images, `stride` control periods apart, the newest a stride ago: squares, kept at
    `kept` and sent at `sent` pixels."""

    length: int
    stride: int
    flow: bool = True
    kept: int = 128
    sent: int = 224


class Recent:
    """Images of one episode by simulated time, for `reach` s."""

    def __init__(self, reach: float) -> None:
        self._reach = reach
        self._held: deque[tuple[float, Image]] = deque()

    def add(self, time: float, image: Image) -> None:
        self._held.append((time, image))
        while len(self._held) > 1 and self._held[1][0] <= time - self._reach + CLOCK_TOLERANCE:
            self._held.popleft()

    def at(self, time: float) -> tuple[float, Image]:
        """The newest no younger than `time`, or the oldest."""
        past = (pair for pair in reversed(self._held) if pair[0] <= time + CLOCK_TOLERANCE)
        return next(past, self._held[0])


class History:
    def __init__(self, settings: HistorySettings, fps: int) -> None:
        self._settings, self._period = settings, settings.stride / fps
        self._held, self._now = Recent(settings.length * self._period), 0.0

    def add(self, time: float, image: Image) -> None:
        self._now = time
        self._held.add(time, scaled(image, (self._settings.kept, self._settings.kept)))

    def images(self) -> list[Image]:
        """Oldest first; the episode's first image replaces missing ones."""
        settings = self._settings
        ages = range(settings.length, -1, -1)
        *past, present = (self._held.at(self._now - n * self._period)[1] for n in ages)
        if settings.flow:
            past = [flow_image(a, b) for a, b in zip(past, [*past[1:], present], strict=True)]
        return [scaled(image, (settings.sent, settings.sent)) for image in past]


def flow_image(before: Image, after: Image) -> Image:
    """Farneback's flow, (H,W,3) RGB, as in StarVLA: hue is direction, value size over its 99th
    percentile."""
    first, second = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (before, after))
    flow = cv2.calcOpticalFlowFarneback(
        first, second, np.zeros((*first.shape, 2), np.float32), 0.5, 3, 15, 3, 5, 1.2, 0
    )
    size, angle = cv2.cartToPolar(flow[..., 0], flow[..., 1], angleInDegrees=True)
    most = float(np.percentile(np.asarray(size, np.float32), 99.0))
    value = np.zeros_like(size) if most < 1e-6 else np.clip(size / most * 255, 0, 255)
    color = np.stack([np.mod(angle / 2, 180), np.full_like(size, 255), value], -1).astype(np.uint8)
    return np.asarray(cv2.cvtColor(color, cv2.COLOR_HSV2RGB), np.uint8)

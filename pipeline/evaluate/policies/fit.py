"""Images and chunks in the form that other servers want."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.data.names import EXPORTED_CAMERAS
from pipeline.poses import Pixels

DATASET_CAMERAS: dict[str, str] = {name: camera for camera, name in EXPORTED_CAMERAS.items()}


def scaled(image: Pixels, size: tuple[int, int]) -> Pixels:
    if image.shape[:2] == size:
        return image
    return np.asarray(cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA), np.uint8)


def pad_to_square(image: Pixels, size: int) -> Pixels:
    """The image (H,W,3) in the middle of a black square of `size` pixels."""
    height, width = image.shape[:2]
    scale = size / max(height, width)
    h, w = max(1, round(height * scale)), max(1, round(width * scale))
    small = cv2.resize(
        image, (w, h), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    )
    out = np.zeros((size, size, 3), np.uint8)
    top, left = (size - h) // 2, (size - w) // 2
    out[top : top + h, left : left + w] = small
    return out


def first_rows(actions: NDArray[np.generic], execute: int | None) -> NDArray[np.generic]:
    return actions if execute is None or actions.ndim < 2 else actions[:execute]

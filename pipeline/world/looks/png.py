"""Textures as PNG files."""

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

LARGEST = 4096  # pixels along an edge


def write_png(texture: NDArray[np.uint8]) -> bytes:
    """The PNG of an image (H,W,4) RGBA."""
    return cv2.imencode(".png", cv2.cvtColor(texture, cv2.COLOR_RGBA2BGRA))[1].tobytes()


def read_png(coded: bytes) -> NDArray[np.uint8]:
    """The image (H,W,4) RGBA of a PNG. Raises ValueError for one that is damaged or too large."""
    size = struct.unpack(">2I", coded[16:24]) if len(coded) > 24 else (0, 0)
    pixels = (
        cv2.imdecode(np.frombuffer(coded, np.uint8), cv2.IMREAD_UNCHANGED)
        if 0 < max(size) <= LARGEST
        else None
    )
    if pixels is None or pixels.shape[2:] != (4,) or pixels.dtype != np.uint8:
        raise ValueError(f"a texture is damaged, or larger than {LARGEST} pixels")
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA), np.uint8)

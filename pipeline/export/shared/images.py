"""Images of an export: color as JPEG, depth and segmentation as PNG."""

from collections.abc import Sequence
from typing import Literal

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.data.episode.frames import QUALITY, decode_frame
from pipeline.poses import Pixels

from .episodes import ExportError

JpegOrder = Literal["rgb", "bgr"]
"""In "rgb" any reader shows the colors; "bgr" is for code that decodes with cv2 and never swaps."""

DEPTH, SEGMENTATION, POINTCLOUD = SENSORS = ("depth", "segmentation", "pointcloud")

IMAGES = {DEPTH: "depth", SEGMENTATION: "actor_segmentation"}
"""Sensor -> its arrays (T,H,W) below a camera."""

IMAGE = pa.struct({"bytes": pa.binary(), "path": pa.string()})
"""What Hugging Face datasets stores an image as."""


def image_column(coded: Sequence[bytes]) -> pa.Array:
    return pa.array([{"bytes": image, "path": None} for image in coded], IMAGE)


def sensors_of(file: EpisodeFile, cameras: Sequence[str]) -> tuple[str, ...]:
    stored = [
        name
        for name, key in IMAGES.items()
        if any(file.has(f"observation/{camera}/{key}") for camera in cameras)
    ]
    return (*stored, *([POINTCLOUD] if file.has(POINTCLOUD) else []))


def coded_images(file: EpisodeFile, camera: str, sensor: str) -> list[bytes]:
    """PNG of depth (16 bits, mm) or segmentation (8). Raises ExportError."""
    key = f"observation/{camera}/{IMAGES[sensor]}"
    if not file.has(key):
        raise ExportError(f"{file.path}: {camera} has no {sensor} images; draw it again with them")
    return [png(image) for image in file.array(key)]


def png(image: NDArray[np.uint16] | Pixels) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def resize(rgb: Pixels, size: tuple[int, int] | None) -> Pixels:
    """Image (H,W,3) at (height, width): area averaging to shrink, else bilinear."""
    if size is None:
        return rgb
    shrinks = size[0] * size[1] < rgb.shape[0] * rgb.shape[1]
    kind = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(rgb, size[::-1], interpolation=kind), np.uint8)


def reencode(stored: bytes, order: JpegOrder, size: tuple[int, int] | None = None) -> bytes:
    """A JPEG in another order or size; unchanged if neither changes."""
    if order == "rgb" and size is None:
        return stored
    rgb = resize(decode_frame(stored), size)
    # cv2 takes what it encodes for BGR
    image, quality = rgb[..., ::-1] if order == "rgb" else rgb, [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
    return cv2.imencode(".jpg", image, quality)[1].tobytes()


def padded(images: list[bytes]) -> Pixels:
    """JPEG bytes as rows (T,N) uint8 that end in zeros."""
    rows = np.zeros((len(images), max(map(len, images))), np.uint8)
    for row, jpeg in zip(rows, images, strict=True):
        row[: len(jpeg)] = np.frombuffer(jpeg, np.uint8)
    return rows

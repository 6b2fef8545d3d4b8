"""Whether the images of an episode are there, decode, have the size of their cameras and show something."""

from collections.abc import Iterator

import numpy as np

from pipeline.data.episode.file import EpisodeError, EpisodeFile
from pipeline.data.episode.jpeg import decode_frame, frame_size
from pipeline.run.verify.tally import Finding, observe

FLAT = 1.0
"""Standard deviation (0-255) below which an image is one flat color."""


def check_images(name: str, file: EpisodeFile) -> Iterator[Finding]:
    """Frames of every camera; depth, segmentation and point clouds where they are stored."""
    frames = len(file)
    for camera, info in file.meta.drawing.cameras.items():
        group, size = f"observation/{camera}", (info.width, info.height)
        coded = file.array(f"{group}/rgb")
        yield observe("frames", len(coded) == frames, f"{name}: {camera} has {len(coded)} images for {frames} timestamps")
        yield observe("jpeg", *_frames(name, camera, [bytes(data) for data in coded], size))
        for key, kind in (("depth", np.uint16), ("actor_segmentation", np.uint8)):
            if file.has(f"{group}/{key}"):
                values = file.array(f"{group}/{key}")
                right = values.shape == (frames, *reversed(size)) and values.dtype == kind
                yield observe("frames", right, f"{name}: {group}/{key} is {values.dtype}{list(values.shape)}")
    if set(file.cameras) != set(file.meta.drawing.cameras):
        yield Finding("frames", f"{name}: has cameras {', '.join(file.cameras)}, and names {', '.join(file.meta.drawing.cameras)}")
    if file.has("pointcloud"):
        cloud = file.array("pointcloud")
        right = cloud.ndim == 3 and len(cloud) == frames and cloud.shape[2] == 6 and bool(np.isfinite(cloud).all())
        yield observe("frames", right, f"{name}: pointcloud is {cloud.dtype}{list(cloud.shape)}, or not finite")


def _frames(name: str, camera: str, coded: list[bytes], size: tuple[int, int]) -> tuple[bool, str]:
    for t, jpeg in enumerate(coded):
        stated = frame_size(jpeg)
        if stated != size:
            return False, f"{name}: {camera} image {t} is {stated}, not {size} pixels"
        try:
            if decode_frame(jpeg).std() <= FLAT:
                return False, f"{name}: {camera} image {t} is one flat color"
        except EpisodeError:
            return False, f"{name}: {camera} image {t} does not decode"
    return True, ""

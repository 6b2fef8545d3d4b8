"""Depth maps of a LeRobot v3.0 dataset: 16-bit PNG in the data files, millimetres along the viewing axis, 0 = nothing seen.

lerobot 0.6 reads features of dtype `image` with `is_depth_map` in their info this way."""

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.data.episode.file import EpisodeFile
from pipeline.export.formats.lerobot.format import before_clock, image_key
from pipeline.export.shared.episodes import Facts
from pipeline.export.shared.sensors import DEPTH, coded_images, image_column
from pipeline.export.shared.statistics import Stats, count_stats, sample_rows, thinning

LEVELS = 2**16


def depth_key(name: str) -> str:
    """Feature of the depth of a camera by its exported name: "cam_high" -> "observation.images.cam_high_depth"."""
    return f"{image_key(name)}_depth"


def with_depth(features: Mapping[str, dict[str, Any]], first: Facts, names: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """The features with one a camera before those of the clock; `names` are the exported names by camera."""
    info = {"is_depth_map": True, "depth_unit": "mm"}
    one = {"dtype": "image", "shape": [*first.size, 1], "names": ["height", "width", "channels"], "info": info}
    described = {depth_key(names[camera]): dict(one) for camera in first.cameras}
    return before_clock(features, described)


def depth_images(file: EpisodeFile, frames: int) -> dict[str, list[bytes]]:
    """Camera -> PNG of 16 bits of the first frames. Raises ExportError for an episode without depth."""
    return {camera: coded_images(file, camera, DEPTH)[:frames] for camera in file.cameras}


def depth_columns(images: Mapping[str, Sequence[bytes]], names: Mapping[str, str]) -> dict[str, pa.Array]:
    """Columns (T rows) in the form of Hugging Face's images."""
    return {depth_key(names[camera]): image_column(coded) for camera, coded in images.items()}


def depth_counts(coded: Sequence[bytes]) -> NDArray[np.int64]:
    """How often each depth occurs, (65536,), in the frames and pixels that enter LeRobot's statistics of images."""
    counts = np.zeros(LEVELS, np.int64)
    for row in sample_rows(len(coded)):
        image = cv2.imdecode(np.frombuffer(coded[row], np.uint8), cv2.IMREAD_UNCHANGED)
        assert image is not None
        step = thinning(*image.shape[:2])
        counts += np.bincount(image[::step, ::step].ravel(), minlength=LEVELS)
    return counts


def depth_stats(counts: NDArray[np.int64], frames: int) -> Stats:
    """Statistics (1,1,1) in mm from counts (65536,) over `frames` images."""
    return count_stats(counts[None], np.arange(LEVELS, dtype=np.float64), frames)

"""Estimates seconds and bytes of a recipe's episode without a measurement.

Fitted to eight datasets of 64x48 to 960x720: bytes within a factor of 1.6, processor time of
1.7."""

import os
from collections.abc import Iterator

from pipeline.data.cameras import CAMERA_TYPES
from pipeline.data.clock import DEFAULT_FPS
from pipeline.data.episode.meta import NamedCamera
from pipeline.data.recipe.model import Cell, Recipe
from pipeline.tasks import TASKS

NATIVE = 320 * 240  # pixels to which the figures below refer
SHARE = 0.2  # length of an episode as a share of its task's step limit
STATES = (95_000, 4300)  # bytes of what is no image: of an episode, and of each frame
IMAGES = {"images": (20_000, 0.74), "depth": (7100, 0.77), "segmentation": (870, 0.77)}
"""Bytes of one frame of one camera of NATIVE pixels, and the power of the pixels."""

CLOUD = 10_800  # bytes of a point cloud
RANDOMIZED = 1.125  # times as many bytes of images in the randomized domain
PHYSICS = 1.3  # core seconds of an accepted episode without images, failed attempts included
# core seconds of a frame of a camera: what every image takes, and what NATIVE pixels take
DRAWING = (0.0015, 0.0032)
SENSORS = 1.5  # times as many seconds of drawing with depth, segmentation or point clouds
# times as many seconds of drawing by preset
SLOWER = {"raster": 1.0, "raster-fast": 0.7, "rt": 100.0}
WRITTEN = 15e6  # bytes that are compressed and written in a second
UNSURE = 1.7  # factor within which the estimates of time lie


def estimate(episodes: int, seconds: float, workers: int) -> tuple[float, float]:
    """Hours for episodes of so many core seconds each: undisturbed, and at most. Workers that are
    no more than this machine's cores share them with its load."""
    hours, cores = episodes * seconds / workers / 3600, os.cpu_count() or 1
    shared = max(1.0, (os.getloadavg()[0] + workers) / cores) if workers <= cores else 1.0
    return hours, UNSURE * shared * hours


def frames(recipe: Recipe, cell: Cell) -> float:
    """Recorded frames of an episode of a cell."""
    seconds = SHARE * TASKS[cell.task].step_limit / DEFAULT_FPS
    return recipe.fps * (seconds + (recipe.lead if cell.level and cell.alpha else 0.0))


def mean_frames(recipe: Recipe) -> float:
    """Recorded frames of an episode of a recipe."""
    counts = recipe.counts()
    return sum(frames(recipe, cell) * count for cell, count in counts.items()) / sum(
        counts.values()
    )


def sizes_of(recipe: Recipe) -> Iterator[float]:
    """Pixels of each camera, relative to NATIVE."""
    kind = CAMERA_TYPES[recipe.camera]
    for camera in recipe.cameras:
        own = (
            (camera.width, camera.height)
            if isinstance(camera, NamedCamera)
            else (kind.width, kind.height)
        )
        width, height = recipe.size or own
        yield width * height / NATIVE


def bytes_of(recipe: Recipe) -> dict[str, float]:
    """Mean bytes of an episode by part."""
    length, counts = mean_frames(recipe), recipe.counts()
    looks = {"clean": 0.0, "randomized": 1.0}
    busy = sum(count for cell, count in counts.items() if cell.domain == "randomized") / sum(
        counts.values()
    )
    more = {"images": 1 + (RANDOMIZED - 1) * looks.get(recipe.visuals, busy)}
    wanted = {"images": True, "depth": recipe.depth, "segmentation": recipe.segmentation}
    parts = {
        name: length
        * more.get(name, 1.0)
        * sum(size * pixels**power for pixels in sizes_of(recipe))
        for name, (size, power) in IMAGES.items()
        if wanted[name]
    }
    if recipe.pointcloud:
        parts["point clouds"] = length * CLOUD
    return parts | {"states": STATES[0] + length * STATES[1]}


def seconds_of(recipe: Recipe) -> float:
    """Mean core seconds of an episode: its share of physics, and drawing and writing it."""
    drawn = mean_frames(recipe) * sum(
        DRAWING[0] + DRAWING[1] * pixels for pixels in sizes_of(recipe)
    )
    drawn *= SLOWER[recipe.render] * (
        SENSORS if recipe.depth or recipe.segmentation or recipe.pointcloud else 1.0
    )
    return PHYSICS / recipe.variants + drawn + sum(bytes_of(recipe).values()) / WRITTEN

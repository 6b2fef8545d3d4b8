"""Point clouds of the workspace, and imperfections of real cameras, as functions of arrays and
named random streams. Light is the square of a pixel value over 255."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from pipeline.data.cameras import CameraType, View, intrinsics
from pipeline.data.imperfections import Sensors
from pipeline.poses import Floats, Floats32, Ints, Pixels, between, quat_rotate
from pipeline.world.physics.body import TABLE_HALF, TABLE_TOP

from .compiled import compiled

POINTS = 1024
ABOVE, HIGHEST = 0.005, 1.0
"""m over the table top between which points count."""

COLUMNS = 320
"""About how many columns of an image are read."""


def point_clouds(view: View, count: int = POINTS) -> Floats32:
    """Clouds (T,count,6): x y z (m, world) and r g b (0-1) on or over the table, by farthest point
    sampling. The first k points are the sample of size k; too few pixels are repeated, none give
    zeros."""
    assert view.depth is not None
    step = max(1, view.camera.type.width // COLUMNS)
    directions = rays(view.camera.type)[::step, ::step]
    clouds = np.zeros((len(view.rgb), count, 6), np.float32)
    half = np.array([*TABLE_HALF, 0.0])
    lower, upper = (
        np.array([0, 0, TABLE_TOP + ABOVE]) - half,
        np.array([0, 0, TABLE_TOP + HIGHEST]) + half,
    )
    depths, images = view.depth[:, ::step, ::step], view.rgb[:, ::step, ::step]
    for cloud, depth, rgb, pose in zip(clouds, depths, images, view.poses, strict=True):
        points = quat_rotate(pose[3:], directions * (depth[..., None] * 1e-3)) + pose[:3]
        inside = (depth > 0) & ((points >= lower) & (points <= upper)).all(-1)
        candidates = points[inside].astype(np.float32)
        if len(candidates):
            taken = farthest_points(candidates, min(count, len(candidates)))
            order = np.resize(taken, count)
            cloud[:, :3], cloud[:, 3:] = candidates[order], rgb[inside][order] / np.float32(255.0)
    return clouds


def rays(kind: CameraType) -> Floats:
    """Rays (H,W,3) of pixels for a depth of 1: x forward, y left, z up."""
    k = intrinsics(kind)
    u, v = np.arange(kind.width) + 0.5, (np.arange(kind.height) + 0.5)[:, None]
    left, up = (k[0, 2] - u) / k[0, 0], (k[1, 2] - v) / k[1, 1]
    return np.stack(np.broadcast_arrays(1.0, left, up), -1)


@compiled
def farthest_points(points: Floats32, count: int) -> Ints:
    """Indices (count,) of points (N,3), N >= count: the first, then each time the farthest from all
    taken."""
    x, y = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1])
    z = np.ascontiguousarray(points[:, 2])
    taken = np.zeros(count, np.int64)
    # squared distances, never negative: their bits are in their order
    gap = np.full(len(points), np.inf, np.float32)
    bits = gap.view(np.int32)
    last = 0
    for i in range(1, count):
        # two plain loops, which compile to vector instructions
        for j in range(len(gap)):
            dx, dy, dz = x[j] - x[last], y[j] - y[last], z[j] - z[last]
            gap[j] = min(gap[j], dx * dx + dy * dy + dz * dz)
        farthest = np.int32(-1)
        for j in range(len(gap)):
            farthest = max(farthest, bits[j])
        last = 0
        while bits[last] != farthest:
            last += 1
        taken[i] = last
    return taken


# electrons of white light at a gain of 1, and of an image without light
FULL_WELL, READ_NOISE = 6000.0, 3.0
KNOTS = 2.0  # s between two drawn values of the drift
BASELINE_FOCAL = 0.05 * 447.0  # m pixels: a D435 at 848x480
DISPARITY_NOISE, DISPARITY_STEP = 0.08, 1 / 32  # pixels
NEAREST, FARTHEST = 0.195, 10.0  # m
# a step of depth, as a share of it, that one of the two cameras cannot see behind; how often it is
# lost
EDGE, LOST = 0.03, 0.5

LIGHT = np.square(np.arange(256, dtype=np.float32) / np.float32(255))
"""Light of each pixel value, 0-1."""


@dataclass(frozen=True)
class Sensing:
    """The imperfections of an episode's cameras."""

    sensors: Sensors
    seed: int
    fps: int

    def rng(self, camera: str, purpose: str, number: int) -> Generator:
        """The random stream of a purpose at a frame (or knot)."""
        key = hashlib.sha256(f"{self.seed}/{camera}/{purpose}/{number}".encode()).digest()
        return np.random.Generator(np.random.Philox(key=int.from_bytes(key[:16], "little")))

    @property
    def shutter(self) -> float:
        """Exposure time in frames."""
        return self.sensors.motion_blur * self.fps / 1000

    def drift(self, camera: str, frame: int) -> Floats32:
        """Factors (3,) of red, green and blue light: exposure varies by up to the drift, red
        against blue by half."""
        knot, between = divmod(frame / (KNOTS * self.fps), 1.0)
        old, new = (self.rng(camera, "drift", int(knot) + k).uniform(-1, 1, 2) for k in (0, 1))
        exposure, warmth = (
            old + (new - old) * (between * between * (3 - 2 * between))
        ) * self.sensors.drift
        return np.asarray(
            (1 + exposure) * np.array([1 + warmth / 2, 1, 1 - warmth / 2]), np.float32
        )

    def developed(self, camera: str, frame: int, light: Floats32) -> Pixels:
        """The image of light (H,W,3). The variance of light L is L g / W + (r g / W)^2 with gain g,
        full well W and read noise r."""
        if self.sensors.drift:
            light = light * self.drift(camera, frame)
        if self.sensors.noise:
            unit = np.float32(self.sensors.noise / FULL_WELL)
            spread = np.sqrt(np.maximum(light, 0) * unit + (np.float32(READ_NOISE) * unit) ** 2)
            light = light + spread * self.rng(camera, "noise", frame).standard_normal(
                light.shape, np.float32
            )
        return np.rint(np.sqrt(np.clip(light, 0, 1)) * np.float32(255)).astype(np.uint8)

    def measured(self, camera: str, frame: int, depth: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Depth (H,W) in mm as of a D435: noisy disparity in steps (3.6 mm at 1 m), holes (0) at
        edges and out of range."""
        rng = self.rng(camera, "depth", frame)
        z = depth.astype(np.float32) / 1000
        seen = (z >= NEAREST) & (z <= FARTHEST)
        disparity = BASELINE_FOCAL / np.maximum(z, NEAREST) + DISPARITY_NOISE * rng.standard_normal(
            z.shape, np.float32
        )
        stepped = np.maximum(np.rint(disparity / DISPARITY_STEP), 1) * DISPARITY_STEP
        kernel = np.ones((3, 3), np.uint8)
        edge = np.asarray(cv2.dilate(z, kernel) - cv2.erode(z, kernel)) > EDGE * z
        seen &= ~(edge & (rng.random(z.shape, np.float32) < LOST))
        return np.where(seen, np.rint(BASELINE_FOCAL / stepped * 1000), 0).astype(np.uint16)


def moved(poses: Mapping[str, Floats], at: ArrayLike) -> dict[str, Floats]:
    """`between` of every body's poses (T,7), at times (N,)."""
    return {name: between(rows, at) for name, rows in poses.items()}

"""Where a target is and how fast, from where it was found in the images of one camera up to now.
Pure NumPy.

A point in an image becomes a point on the plane at the height that the target had in training; a
Kalman filter of constant velocity weighs each sighting by the error that the finder expects of it,
so a hidden target keeps its course.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.cameras import CameraType, extrinsics_cv, intrinsics, project
from pipeline.poses import Floats, quat_rotate

AXES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""The points of a target that are found, in its frame, in units of the finder's reach: its origin,
and one on each of two axes."""


def track_numbers(points: int) -> int:
    """Numbers of a track of so many points: x and y of the origin, of its velocity, and of the way
    to each further point."""
    return 2 * points + 2


UNSTEADY = 0.25
"""Standard deviation (m/s2) of the acceleration that the filter expects of a target."""

SLOW = 0.1
"""Standard deviation (m/s) of the velocity that is expected before the target has been seen
twice."""

TURNING = 0.05
"""Standard deviation (m/s) at which the ways from the origin to the further points are expected to
change."""

SURPRISE = 3.0
"""Standard deviations beyond which a sighting counts as less exact than the finder expects."""


@dataclass(frozen=True)
class TargetView:
    """A fixed camera that sees targets on a table.

    Size of its images (height, width), vertical field of view (degrees), world pose (x forward, y
    left, z up), height (m) of the targets' origins, and distance (m) of the further points.
    """

    size: tuple[int, int]
    fovy: float
    pose: tuple[float, ...]
    height: float
    reach: float

    @property
    def camera(self) -> CameraType:
        return CameraType(self.size[1], self.size[0], self.fovy)

    def pixels(self, poses: ArrayLike, further: ArrayLike | None = None) -> Floats:
        """(N,K,2) columns and rows (px) of the points of targets at world poses (N,7), the
        `further` ones (N,J,3) m last.

        These are in the frames of the targets."""
        poses = np.asarray(poses, float)
        points = np.broadcast_to(self.reach * AXES, (len(poses), *AXES.shape))
        if further is not None:
            points = np.concatenate([points, np.asarray(further, float)], 1)
        points = poses[:, None, :3] + quat_rotate(poses[:, None, 3:], points)
        return project(self.camera, np.array(self.pose), points)[0]

    def places(self, pixels: ArrayLike) -> Floats:
        """(...,2) world x and y (m) of pixels (...,2) on the plane of the targets' origins."""
        pixels = np.asarray(pixels, float)
        ones = np.ones((*pixels.shape[:-1], 1))
        inverse, turn, eye = self._rays
        rays = np.concatenate([pixels, ones], -1) @ inverse @ turn
        # a ray that does not go down never meets the plane: what is found above the horizon is
        # taken for far away
        down = np.minimum(rays[..., 2:], -1e-2)
        return eye[:2] + rays[..., :2] * (self.height - eye[2]) / down

    @cached_property
    def _rays(self) -> tuple[Floats, Floats, Floats]:
        world = extrinsics_cv(np.array(self.pose))
        turn = world[:, :3]
        inverse = np.asarray(np.linalg.inv(intrinsics(self.camera)).T, float)
        return inverse, turn, -turn.T @ world[:, 3]

    def metres(self, pixels: float) -> float:
        """Metres on the plane, in the middle of the image, of so many pixels."""
        middle = np.array([self.size[1], self.size[0]]) / 2
        ends = self.places(middle + np.array([[-0.5, 0.0], [0.5, 0.0]]))
        return pixels * float(np.linalg.norm(ends[1] - ends[0]))

    @classmethod
    def parse(cls, values: Mapping[str, Any]) -> "TargetView":
        """Inverse of `dataclasses.asdict`."""
        return cls(**{**values, "size": tuple(values["size"]), "pose": tuple(values["pose"])})


class Track:
    """A target as it was seen so far: `see` takes one sighting after another.

    Without `memory` only the last sighting counts, and the velocity is 0."""

    def __init__(self, sight: TargetView, memory: bool = True) -> None:
        self._sight, self._pixel, self._memory = sight, sight.metres(1.0), memory
        self._time = -np.inf
        self._motion, self._cov = np.zeros((2, 2)), np.zeros((2, 2))
        self._ways, self._spread = np.zeros((0, 2)), np.zeros((0, 1))

    def see(self, time: float, pixels: ArrayLike, errors: ArrayLike) -> None:
        """Take in points found at `pixels` (K,2) at `time` (s), with the errors (K,) px that are
        expected of them.

        A time that was seen already changes nothing: a question that failed in company is asked
        again alone.
        """
        if time <= self._time:
            return
        found = self._sight.places(pixels)
        variance = (self._pixel * np.asarray(errors, float)) ** 2
        ways = found[1:] - found[0]
        if not self._memory or not np.isfinite(self._time):
            self._motion[0], self._cov = found[0], np.diag([variance[0], SLOW**2])
            self._ways, self._spread = ways, variance[1:, None]
        else:
            dt = time - self._time
            ahead, noise = np.array([[1.0, dt], [0.0, 1.0]]), UNSTEADY * np.array([dt**2 / 2, dt])
            self._motion, self._cov = (
                ahead @ self._motion,
                ahead @ self._cov @ ahead.T + np.outer(noise, noise),
            )
            missed = found[0] - self._motion[0]
            expected = self._cov[0, 0] + variance[0]
            # a sighting far from where it was expected is trusted less
            expected *= max(1.0, float(missed @ missed) / expected / SURPRISE**2)
            gain = self._cov[:, 0] / expected
            self._motion = self._motion + gain[:, None] * missed
            self._cov = self._cov - np.outer(gain, self._cov[0])
            self._spread = self._spread + (TURNING * dt) ** 2
            share = self._spread / (self._spread + variance[1:, None])
            self._ways, self._spread = (
                self._ways + share * (ways - self._ways),
                (1 - share) * self._spread,
            )
        self._time = time

    @property
    def speed(self) -> float:
        """Speed (m/s) on the plane."""
        return float(np.linalg.norm(self._motion[1]))

    @property
    def numbers(self) -> NDArray[np.float32]:
        """(2 K + 2,) position (m), velocity (m/s), ways to the further points (m)."""
        return np.concatenate([self._motion.ravel(), self._ways.ravel()]).astype(np.float32)


class Tracks:
    """The tracks of the target and of the bodies that the same images show besides."""

    def __init__(self, sight: TargetView, bodies: int, memory: bool = True) -> None:
        self._each = [Track(sight, memory) for _ in range(bodies)]

    def see(self, time: float, pixels: ArrayLike, errors: ArrayLike) -> None:
        """As `Track.see`, the points of one body after those of another."""
        of_each = (np.split(np.asarray(values), len(self._each)) for values in (pixels, errors))
        for track, points, doubts in zip(self._each, *of_each, strict=True):
            track.see(time, points, doubts)

    @property
    def speed(self) -> float:
        """Speed (m/s) of the target on the plane."""
        return self._each[0].speed

    @property
    def numbers(self) -> NDArray[np.float32]:
        """The numbers of one track after another."""
        return np.concatenate([track.numbers for track in self._each])


NEAR = 0.04
"""Ways (m) on the table that `aims` tells finely."""

LOW, LIFT = 0.77, 0.03
"""Height (m) in the world, 3 cm over the table, around which `aims` tells heights of tools finely,
and the differences (m) from it that it does."""


def aim_numbers(points: int, bodies: int = 1, near: bool = False) -> int:
    """Numbers of `aims` for tracks of so many points each."""
    return bodies * (track_numbers(points) + 4) + 6 + near * (4 * bodies + 2)


def aims(
    track: NDArray[Any], tools: NDArray[Any], bodies: int = 1, near: bool = False
) -> NDArray[np.float32]:
    """Features (B,F) of the tracks (B,M) of bodies and the positions (B,2,3) of both tools, as a
    network's input.

    The tracks, the tools, and the displacements on the table from each tool to each body. With
    `near` those displacements in units of NEAR and the heights of the tools over LOW in units of
    LIFT as well, through tanh: in deviations over a whole episode, a centimetre is little."""
    places = track.reshape(len(track), bodies, -1)[:, :, None, :2]
    ways = (places - tools[:, None, :, :2]).reshape(len(track), -1)
    parts = [track, tools.reshape(len(track), -1), ways]
    if near:
        parts += [np.tanh(ways / NEAR), np.tanh((tools[:, :, 2] - LOW) / LIFT)]
    return np.concatenate(parts, 1).astype(np.float32)


CHOICES = ("left", "right", "both")
"""Which arms act in an episode."""

"""What a motion brings with it, as plain data that no physics touches."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Floats, Pose, pose

SHEET = 0.0015  # m, thickness of belts and discs

AWAY: Pose = pose((0.0, 0.0, -5.0))
"""Where scenery waits unseen: below the floor, which hides it from every camera."""

HOOD, STRIPS = (0.16, 0.30, 0.42), ((0.07, 0.07, 0.08), (0.10, 0.10, 0.11))


@dataclass(frozen=True, eq=False)
class Piece:
    """A box, cylinder or sphere at a pose (7,) in its prop; `size` (m) as of a Collider."""

    kind: Literal["box", "cylinder", "sphere"]
    size: tuple[float, ...]
    at: Pose
    colour: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Prop:
    """A rigid thing and its pose (..., 7) until the release. The robot must not touch a `solid` one
    before the meeting."""

    name: str
    pieces: tuple[Piece, ...]
    pose: Callable[[ArrayLike], Floats]
    solid: bool = False


def standing(at: Pose) -> Callable[[ArrayLike], Floats]:
    return lambda t: np.broadcast_to(at, (*np.shape(t), 7))


def flat(
    kind: Literal["box", "cylinder"],
    size: tuple[float, ...],
    height: float,
    colour: tuple[float, float, float],
) -> Piece:
    """A piece from its prop's origin up to `height` m; `size` without its half height."""
    return Piece(kind, (*size, height / 2), pose((0, 0, height / 2)), colour)


def hood(half_length: float, half_width: float, height: float) -> tuple[Piece, ...]:
    """A tunnel along x, `half_width` and `height` (m) inside, with curtains."""
    wall = 0.002
    sides = (pose((0, y, height / 2)) for y in (half_width + wall, -half_width - wall))
    walls = [Piece("box", (half_length, wall, height / 2), side, HOOD) for side in sides]
    roof = Piece("box", (half_length, half_width + 2 * wall, wall), pose((0, 0, height)), HOOD)
    strips = max(4, round(half_width / 0.006))
    wide, curtains = half_width / strips, list[Piece]()
    for x, k in product((half_length - 0.002, 0.002 - half_length), range(strips)):
        place = pose((x, (2 * k + 1 - strips) * wide, height / 2))
        curtains.append(Piece("box", (0.0008, wide, height / 2), place, STRIPS[k % 2]))
    return (*walls, roof, *curtains)


def rod(
    start: ArrayLike, end: ArrayLike, radius: float, colour: tuple[float, float, float]
) -> Piece:
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length
    half = (1 + z[2], -z[1], z[0], 0.0) if z[2] > -1 + 1e-9 else (0.0, 1.0, 0.0, 0.0)
    return Piece("cylinder", (radius, length / 2), pose((a + b) / 2, half), colour)

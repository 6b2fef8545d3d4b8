"""Small helpers every family uses: drawing from lists, marking frames, and words for sizes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipeline.poses import Pose, frame
from pipeline.world.objects.contract import Grasp, NamedFrames

COLOURS = (
    "red", "green", "blue", "yellow", "orange", "purple", "pink", "teal", "cyan", "magenta", "lime", "navy", "maroon", "coral",  # noqa: E501
    "turquoise", "indigo", "white", "black", "gray", "brown", "beige", "mint", "lavender", "sky blue", "dark green", "rust",  # noqa: E501
)  # fmt: skip
PASTELS = (
    "white",
    "cream",
    "beige",
    "mint",
    "lavender",
    "sky blue",
    "pink",
    "coral",
    "turquoise",
    "yellow",
)
DARKS = ("black", "charcoal", "navy", "maroon", "dark green", "indigo", "brown", "gray")
BRANDS = (
    "NOVA",
    "LUMA",
    "KIRO",
    "BERG",
    "SOLA",
    "TIVO",
    "MIRA",
    "ORBIT",
    "PEAK",
    "ZEST",
    "FLUX",
    "ALTO",
    "DELI",
    "RIVA",
)

Range = tuple[float, float]


def pick[T](rng: np.random.Generator, options: Sequence[T]) -> T:
    """One of `options`, all equally likely."""
    return options[int(rng.integers(len(options)))]


def other[T](rng: np.random.Generator, options: Sequence[T], than: T) -> T:
    """One of `options` that is not `than`."""
    return pick(rng, [o for o in options if o != than])


def seed(rng: np.random.Generator) -> int:
    """An integer that fixes a texture."""
    return int(rng.integers(1 << 30))


def mark(
    x: float, y: float, z: float, normal: ArrayLike = (0, 0, 1), heading: ArrayLike = (1, 0, 0)
) -> Pose:
    """A functional frame at (x, y, z) m: its z axis is `normal`, its x axis as near `heading` as
    that allows."""
    n = np.asarray(normal, float)
    n = n / np.linalg.norm(n)
    h = np.asarray(heading, float)
    h = h - n * (h @ n)
    return frame((x, y, z), h, np.cross(n, h))


def standing(height: float, grasps: Sequence[Grasp] = (), **points: Pose) -> NamedFrames:
    """Frames of an object of `height` (m) that stands at its origin: "base", "top" above it, and
    `points`; and its grasps."""
    return NamedFrames({"base": mark(0, 0, 0), "top": mark(0, 0, height), **points}, tuple(grasps))


def hollow(height: float, wall: float, grasps: Sequence[Grasp] = (), **points: Pose) -> NamedFrames:
    """`standing`, with "inside" and "centre" on the floor of a hollow thing, `wall` (m) thick."""
    floor = mark(0, 0, wall)
    return standing(height, grasps, inside=floor, centre=floor, **points)


def lean(out: float, up: float) -> float:
    """Degrees from the vertical of a wall that goes `out` over a height `up`."""
    return float(np.degrees(np.arctan2(out, up)))


def size_word(
    value: float, bounds: Range, words: tuple[str, str, str] = ("small", "medium-sized", "large")
) -> str:
    """Which third of the family's range a value lies in, as a word."""
    share = (value - bounds[0]) / (bounds[1] - bounds[0])
    return words[min(2, max(0, int(3 * share)))]

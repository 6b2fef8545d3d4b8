"""All patterns of surfaces by name, and the texture of one from its seed."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pipeline.world.looks.tabletops import TABLETOPS
from pipeline.world.looks.textures import BASIC, Rgba
from pipeline.world.looks.walls import DISTANT, WALLS

PATTERNS: dict[str, Callable[[np.random.Generator, int, ArrayLike], Rgba]] = (
    BASIC | TABLETOPS | WALLS | DISTANT
)
SIZES = dict.fromkeys(TABLETOPS, 512) | dict.fromkeys(WALLS, 512)
"""Texels a side of what is drawn finer than the usual 256."""


def texture(pattern: str, seed: int, colour: ArrayLike, size: int | None = None) -> Rgba:
    """Texture (size,size,4) of a named pattern from an integer seed. Raises KeyError for an
    unknown one."""
    if pattern not in PATTERNS:
        raise KeyError(
            f"texture pattern {pattern!r} is unknown: patterns are {', '.join(PATTERNS)}"
        )
    rng = np.random.Generator(np.random.Philox(seed))
    return PATTERNS[pattern](rng, size or SIZES.get(pattern, 256), colour)

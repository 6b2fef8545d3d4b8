"""An episode's room and lights as data."""

from dataclasses import dataclass
from typing import Annotated

from pipeline.data.parsing import unless

Triple = tuple[float, float, float]

FIRST_LOOK, SECOND_LOOK, THIRD_LOOK, LOOK = 1, 2, 3, 4
"""How images are computed. `Visuals` without a number were stored before soft shadows; those of the
second look before poses were rounded, and those of the third before our own rasteriser."""


@dataclass(frozen=True)
class Surface:
    """A textured surface: pattern, its seed, sRGB colour 0-1, and the size (m) of one tile."""

    pattern: str
    seed: int
    color: Triple
    tile: float


@dataclass(frozen=True)
class PointLight:
    """Position (m, world) and colour; a surface facing it at 1 m receives exactly `color`."""

    position: Triple
    color: Triple


@dataclass(frozen=True)
class Visuals:
    """Looks of an episode. A white surface facing a light of 1 is just white before tone
    mapping."""

    table: Surface
    wall: Surface
    ground: Surface
    ambient: Triple
    sun_direction: Triple  # the way the light travels, world frame, any length
    sun: Triple
    points: tuple[PointLight, ...]
    look: Annotated[int, unless(FIRST_LOOK)] = FIRST_LOOK

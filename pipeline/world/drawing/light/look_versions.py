"""The looks that images are drawn in, by the number in an episode's `Visuals`: shaders, shadow
masks, occlusion and edges."""

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from pipeline.data.episode.visuals import FIRST_LOOK, LOOK
from pipeline.world.drawing.light.occlusion import opened
from pipeline.world.drawing.light.penumbra import Depths, Ground, Masks, hard, soft
from pipeline.world.drawing.light.planes import embossed
from pipeline.world.shapes import Parts


@dataclass(frozen=True)
class Look:
    """How light is computed. `shaders` is added to the names of our shader folders; `masks`
    makes the planes' shadow masks. `prepare` gets bodies ready, `surface` the table for the
    direction of the sun. `edges` allows presets to smooth edges."""

    shaders: str
    masks: Callable[[Depths, Ground], Masks]
    prepare: Callable[[Parts], Parts]
    surface: Callable[[Parts, ArrayLike], Parts]
    edges: bool


LOOKS = {
    FIRST_LOOK: Look(
        "_first", hard, lambda parts: parts, lambda parts, direction: parts, edges=False
    ),
    LOOK: Look("", soft, opened, embossed, edges=True),
}


def look_of(number: int) -> Look:
    """The look of that number. Raises ValueError for one that only a later version draws."""
    if number not in LOOKS:
        raise ValueError(
            f"look {number} is unknown: looks are {', '.join(map(str, LOOKS))}; a later version"
            " drew this episode"
        )
    return LOOKS[number]

"""The looks that images are drawn in, by the number in an episode's `Visuals`: shaders, shadow masks, occlusion and edges."""

from collections.abc import Callable
from dataclasses import dataclass

from pipeline.data.episode.visuals import FIRST_LOOK, LOOK
from pipeline.world.occlusion import opened
from pipeline.world.penumbra import Depths, Ground, Masks, hard, soft
from pipeline.world.shapes import Parts


@dataclass(frozen=True)
class Look:
    """How light is computed.

    `shaders` is added to the names of our shader folders, `masks` makes the planes' shadow masks from the depths of the shadow map,
    `prepare` gets bodies ready, and `edges` allows presets to smooth edges.
    """

    shaders: str
    masks: Callable[[Depths, Ground], Masks]
    prepare: Callable[[Parts], Parts]
    edges: bool


LOOKS = {
    FIRST_LOOK: Look("_first", hard, lambda parts: parts, edges=False),
    LOOK: Look("", soft, opened, edges=True),
}


def look_of(number: int) -> Look:
    """The look of that number. Raises ValueError for one that only a later version draws."""
    if number not in LOOKS:
        raise ValueError(f"look {number} is unknown: looks are {', '.join(map(str, LOOKS))}; a later version drew this episode")
    return LOOKS[number]

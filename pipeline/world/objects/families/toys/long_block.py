"""A tall square bar, standing: the giver takes it low, the receiver high."""

from dataclasses import dataclass
from functools import partial

from pipeline.world.looks.materials import painted, worn
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, box
from pipeline.world.objects.grasping import PITCHES, box_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import Parametric, between, one_of
from pipeline.world.shapes import Shape

SHORT_OF_THE_MIDDLE = (0.0, 0.004, 0.008, 0.012, 0.016, 0.020)
"""Distances (m) by which the tcp may stay short of the middle: the block is wide, a palm that leans
needs room."""

HALF = 0.03
HEIGHT = 0.20
"""Half width and height (m): the same for all, as the original's."""


@register("long_block")
@dataclass(frozen=True)
class LongBlock(Parametric):
    colour: str = one_of(("red", "maroon", "coral", "rust"))
    bevel: float = between(0.001, 0.005)
    band: str = one_of(COLOURS, other_than="colour")  # colour of the ring round the middle
    band_width: float = between(0.006, 0.025)

    def shape(self) -> Shape:
        w, h = HALF, HEIGHT / 2
        ring = box(w + 0.0004, w + 0.0004, self.band_width / 2)
        return Shape(
            visual=(
                (at(box(w, w, h, self.bevel), (0, 0, h)), worn(self.colour, 5)),
                (at(ring, (0, 0, h)), painted(self.band)),
            ),
            collision=box_collider(w, w, h, (0, 0, h)),
            mass=400 * 8 * w * w * h,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        w, h = HALF, HEIGHT
        grips = partial(
            box_pinches, w, w, h / 2, pitches=PITCHES, offsets=(0.0,), retreats=SHORT_OF_THE_MIDDLE
        )
        low = grips(heights=(0.035, 0.055, 0.09), kind="low")
        high = grips(heights=(h - 0.07, h - 0.05, h - 0.03), kind="high")
        return standing(h, (*low, *high), middle=mark(0, 0, h / 2))

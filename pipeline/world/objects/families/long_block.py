"""A tall square bar, standing: the giver takes it low, the receiver high."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.materials import painted
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.geometry import at, box
from pipeline.world.objects.grasping import PITCHES, box_pinches
from pipeline.world.objects.kit import COLOURS, mark, other, pick, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

HEIGHT = (0.18, 0.215)
HALF = (0.0225, 0.027)


@register("long_block")
@dataclass(frozen=True)
class LongBlock(Family):
    half: float
    height: float
    bevel: float
    colour: str
    band: str  # colour of the ring round the middle
    band_width: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        colour = pick(rng, ("red", "maroon", "coral", "rust"))
        return cls(
            rng.uniform(*HALF),
            rng.uniform(*HEIGHT),
            rng.uniform(0.001, 0.005),
            colour,
            other(rng, COLOURS, colour),
            rng.uniform(0.006, 0.025),
        )

    def shape(self) -> Shape:
        w, h = self.half, self.height / 2
        ring = box(w + 0.0004, w + 0.0004, self.band_width / 2)
        return Shape(
            visual=((at(box(w, w, h, self.bevel), (0, 0, h)), painted(self.colour)), (at(ring, (0, 0, h)), painted(self.band))),
            collision=box_collider(w, w, h, (0, 0, h)),
            mass=400 * 8 * w * w * h,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        w, h = self.half, self.height
        low = box_pinches(w, w, h / 2, heights=(0.035, 0.055), pitches=PITCHES, offsets=(0.0,), kind="low")
        high = box_pinches(w, w, h / 2, heights=(h - 0.05, h - 0.03), pitches=PITCHES, offsets=(0.0,), kind="high")
        return NamedFrames({"base": mark(0, 0, 0), "top": mark(0, 0, h), "middle": mark(0, 0, h / 2)}, (*low, *high))

    def words(self) -> Words:
        return describe(
            "long_block",
            "long block",
            colour=self.colour,
            size=size_word(self.half, HALF, ("slim", "medium-sized", "thick")),
            band=self.band,
        )

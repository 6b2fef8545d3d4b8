"""A board eraser: a felt pad under a plastic back."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.looks.materials import fabric, plastic
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.geometry import at, box
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, mark, pick, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

LENGTH = (0.09, 0.13)
FELT = 0.4  # share of the height


@register("eraser")
@dataclass(frozen=True)
class Eraser(Family):
    length: float  # along x
    width: float
    height: float
    colour: str  # of the back

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        return cls(
            rng.uniform(*LENGTH),
            rng.uniform(0.044, 0.056),
            rng.uniform(0.03, 0.042),
            pick(rng, COLOURS),
        )

    def shape(self) -> Shape:
        a, b, h = self.length / 2, self.width / 2, self.height
        felt = at(box(a, b, FELT * h / 2), (0, 0, FELT * h / 2))
        back = at(box(a, b, (1 - FELT) * h / 2, 0.003), (0, 0, (1 + FELT) * h / 2))
        return Shape(
            visual=((felt, fabric("charcoal")), (back, plastic(self.colour))),
            collision=box_collider(a, b, h / 2, (0, 0, h / 2)),
            mass=300 * 4 * a * b * h,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        points = {"base": mark(0, 0, 0), "top": mark(0, 0, self.height)}
        return NamedFrames(
            points, box_pinches(self.length / 2, self.width / 2, self.height / 2, axes="y")
        )

    def words(self) -> Words:
        return describe("eraser", "eraser", colour=self.colour, size=size_word(self.length, LENGTH))

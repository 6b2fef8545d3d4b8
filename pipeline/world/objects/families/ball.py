"""A small ball, such as is tipped out of a bin."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.materials import plastic, rubber
from pipeline.world.objects.colliders import sphere_collider
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.geometry import at, sphere
from pipeline.world.objects.kit import COLOURS, mark, pick, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

RADIUS = (0.007, 0.010)


@register("ball")
@dataclass(frozen=True)
class Ball(Family):
    radius: float
    density: float
    material: str
    colour: str

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        return cls(rng.uniform(*RADIUS), rng.uniform(900, 1500), pick(rng, ("plastic", "rubber")), pick(rng, COLOURS))

    def shape(self) -> Shape:
        r = self.radius
        skin = plastic(self.colour) if self.material == "plastic" else rubber(self.colour)
        return Shape(
            visual=((at(sphere(r, 8, 14), (0, 0, r)), skin),),
            collision=sphere_collider(r, (0, 0, r)),
            mass=self.density * 4 / 3 * np.pi * r**3,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        return NamedFrames({"base": mark(0, 0, 0), "top": mark(0, 0, 2 * self.radius), "middle": mark(0, 0, self.radius)})

    def words(self) -> Words:
        return describe("ball", "ball", colour=self.colour, size=size_word(self.radius, RADIUS), material=self.material)

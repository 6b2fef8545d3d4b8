"""A small ball, such as is tipped out of a bin."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import plastic, rubber
from pipeline.world.objects.colliders import sphere_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, sphere
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape


@register("ball")
@dataclass(frozen=True)
class Ball(Parametric):
    radius: float = between(0.007, 0.010, size=LARGE)
    density: float = between(900, 1500)
    material: str = one_of(("plastic", "rubber"))
    colour: str = one_of(COLOURS)

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
        return standing(2 * self.radius, middle=mark(0, 0, self.radius))

"""A plain wooden block in one of three forms: brick, cylinder, half-round arch block."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import WOODS, wood
from pipeline.world.objects.colliders import box_collider, disc, prism_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, box, cylinder, side_prism
from pipeline.world.objects.grasping import box_pinches, side_pinches
from pipeline.world.objects.kit import standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape


@register("wooden_block")
@dataclass(frozen=True)
class WoodenBlock(Parametric):
    form: str = one_of(("brick", "cylinder", "wedge"))
    length: float = between(0.06, 0.1, size=LARGE)  # along x; the height of a cylinder
    half: float = between(0.02, 0.031)  # half width, or radius
    height: float = between(0.036, 0.055)
    colour: str = one_of(tuple(WOODS))
    seed: int = texture()

    def wedge(self) -> np.ndarray:
        """Outline (4,2) of the wedge in x and z."""
        a, h = self.length / 2, self.height
        return np.array([(-a, 0), (a, 0), (0.35 * a, h), (-0.35 * a, h)])

    def shape(self) -> Shape:
        a, b, h = self.length / 2, self.half, self.height
        if self.form == "brick":
            mesh, pieces = (
                at(box(a, b, h / 2, 0.0025), (0, 0, h / 2)),
                box_collider(a, b, h / 2, (0, 0, h / 2)),
            )
        elif self.form == "cylinder":
            mesh, pieces = cylinder(b, self.length, 24, 0.002), disc(b, self.length)
        else:
            mesh, pieces = side_prism(self.wedge(), b, 0.002), prism_collider(self.wedge(), b)
        size = (
            np.pi * b * b * self.length
            if self.form == "cylinder"
            else 4 * a * b * h * (0.68 if self.form == "wedge" else 1)
        )
        return Shape(
            visual=((mesh, wood(self.colour, self.seed)),),
            collision=pieces,
            mass=650 * size,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        a, b = self.length / 2, self.half
        if self.form == "cylinder":
            return standing(
                self.length,
                side_pinches(b, (0.55 * self.length,), outline=[(b, 0.0), (b, self.length)]),
            )
        spread = (-0.2, 0.0, 0.2) if self.form == "brick" else (0.0,)
        return standing(self.height, box_pinches(a, b, self.height / 2, offsets=spread, axes="y"))

    def facts(self) -> dict[str, str]:
        return super().facts() | {"form": "trapezoid" if self.form == "wedge" else self.form}

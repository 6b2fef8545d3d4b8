"""A flat pad: a goal to set things on."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.looks.materials import print_texture, printed, worn
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import extrude, rounded_rectangle
from pipeline.world.objects.kit import COLOURS, mark, pick, seed, size_word, standing
from pipeline.world.objects.parameters import Parametric
from pipeline.world.shapes import Shape

HALF = (0.045, 0.075)
SKINS = ("fabric", "rubber", "painted")


@register("pad")
@dataclass(frozen=True)
class Pad(Parametric):
    hx: float
    hy: float
    thickness: float
    corner: float
    material: str
    colour: str
    seed: int

    @classmethod
    def draw(
        cls,
        rng: np.random.Generator,
        half: tuple[float, float] | None = None,
        thickness: float | None = None,
        colour: str = "",
    ) -> Self:
        """`half` extents (m), `thickness` (m) and `colour` are drawn unless given."""
        drawn = (rng.uniform(*HALF), rng.uniform(*HALF))
        hx, hy = half or drawn
        return cls(
            hx,
            hy,
            rng.uniform(0.004, 0.007) if thickness is None else thickness,
            rng.uniform(0.001, 0.2) * min(hx, hy),
            pick(rng, SKINS),
            colour or pick(rng, COLOURS),
            seed(rng),
        )

    def shape(self) -> Shape:
        bevel = min(0.001, 0.3 * self.thickness)
        corner = max(self.corner, 2 * bevel)  # the chamfer of a tighter corner turns inside out
        mesh = extrude(rounded_rectangle(self.hx, self.hy, corner, 3), self.thickness, bevel)
        skin = {
            "fabric": printed(print_texture(self.colour, "cream", "hem", seed=self.seed), 0.95),
            "rubber": worn(self.colour, self.seed, 0.9),
            "painted": worn(self.colour, self.seed),
        }[self.material]
        return Shape(
            visual=((mesh, skin),),
            collision=box_collider(
                self.hx, self.hy, self.thickness / 2, (0, 0, self.thickness / 2)
            ),
            mass=900 * 4 * self.hx * self.hy * self.thickness,
            friction=0.8,
        )

    def frames(self) -> NamedFrames:
        return standing(self.thickness, centre=mark(0, 0, self.thickness))

    def facts(self) -> dict[str, str]:
        return super().facts() | {
            "size": size_word(self.hx * self.hy, (HALF[0] ** 2, HALF[1] ** 2))
        }

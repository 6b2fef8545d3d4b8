"""A cube, about 5 cm."""

from dataclasses import dataclass

from pipeline.world.looks.materials import painted, plastic, rubber, worn
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, box
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape

SKINS = {"painted": (painted, 600.0), "plastic": (plastic, 500.0), "rubber": (rubber, 700.0)}


@register("block")
@dataclass(frozen=True)
class Block(Parametric):
    side: float = between(0.044, 0.056, size=LARGE)
    bevel: float = between(0.001, 0.006)
    material: str = one_of(tuple(SKINS))
    colour: str = one_of(COLOURS)

    def shape(self) -> Shape:
        h = self.side / 2
        skin, density = SKINS[self.material]
        return Shape(
            visual=(
                (
                    at(box(h, h, h, self.bevel), (0, 0, h)),
                    worn(self.colour, round(self.side * 1e6), skin(self.colour).roughness),
                ),
            ),
            collision=box_collider(h, h, h, (0, 0, h)),
            mass=density * self.side**3,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        h = self.side / 2
        return standing(
            self.side,
            box_pinches(h, h, h, heights=(max(h, 0.022),), offsets=(0.0,)),
            centre=mark(0, 0, self.side),
        )

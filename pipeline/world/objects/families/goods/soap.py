"""A bar of soap."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import print_texture, printed, srgb
from pipeline.world.objects.colliders import convex_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import decal, rounded_rectangle, stack, stacked
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, PASTELS, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Material, Shape

ROUND = (
    (0.0, 0.86, 0.82), (0.06, 0.93, 0.91), (0.16, 0.985, 0.98), (0.30, 1.0, 1.0), (0.64, 1.0, 1.0),
    (0.80, 0.98, 0.97), (0.91, 0.94, 0.91), (0.975, 0.88, 0.84), (1.0, 0.82, 0.78),
)  # fmt: skip
LEVELS = ((0.0, 0.9, 0.86), (0.22, 1.0, 1.0), (0.72, 1.0, 1.0), (0.93, 0.93, 0.9), (1.0, 0.84, 0.8))


@register("soap")
@dataclass(frozen=True)
class Soap(Parametric):
    length: float = between(0.072, 0.095, size=LARGE)
    half: float = between(0.024, 0.031)
    height: float = between(0.026, 0.034)
    corner: float = between(0.3, 1.0)  # roundness of the outline, as a share of the half width
    stamp: float = between(0.4, 0.65)  # share of the top that is embossed
    colour: str = one_of(PASTELS + COLOURS)

    def shape(self) -> Shape:
        outline = rounded_rectangle(self.length / 2, self.half, self.corner * self.half, 4)
        levels = [(z * self.height, x, y) for z, x, y in LEVELS]
        skin = Material(srgb(self.colour), roughness=0.3)
        r, g, b = srgb(self.colour)
        pressed = printed(
            print_texture(self.colour, (0.72 * r, 0.72 * g, 0.72 * b), "pressed", "SOAP"), 0.3
        )
        top = decal(
            1.3 * self.stamp * self.length,
            1.3 * self.stamp * self.half,
            (0, 0, self.height + 0.0002),
        )
        bar = stack(
            rounded_rectangle(self.length / 2, self.half, self.corner * self.half, 9),
            ROUND * np.array([self.height, 1, 1]),
            60,
        )
        return Shape(
            visual=((bar, skin), (top, pressed)),
            collision=convex_collider(stacked(outline, levels).reshape(-1, 3)),
            mass=1000 * self.length * 2 * self.half * self.height * 0.85,
            friction=0.4,
        )

    def frames(self) -> NamedFrames:
        return standing(
            self.height,
            box_pinches(
                self.length / 2, self.half, self.height / 2, axes="y", offsets=(-0.2, 0.0, 0.2)
            ),
        )

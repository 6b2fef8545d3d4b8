"""A pill bottle with a wide cap."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import plastic, print_texture, printed
from pipeline.world.objects.colliders import cylinder_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, band, cylinder, revolve
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import BRANDS, COLOURS, mark, standing
from pipeline.world.objects.parameters import TALL, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape


@register("pill_bottle")
@dataclass(frozen=True)
class PillBottle(Parametric):
    radius: float = between(0.02, 0.027)
    colour: str = one_of(("orange", "white", *COLOURS))
    height: float = between(0.07, 0.1, size=TALL)
    cap: float = between(0.014, 0.02)  # height of the cap
    cap_radius: float = between(0.82, 1.0, of="radius")
    cap_colour: str = one_of(("white", *COLOURS), other_than="colour")
    ink: str = one_of(("red", "blue", "green", "purple", "black", "teal"))
    brand: str = one_of(BRANDS)
    seed: int = texture()

    def shape(self) -> Shape:
        r, top = self.radius, self.height - self.cap
        body = revolve(
            [(0, 0), (0.93 * r, 0), (r, 0.002), (r, top - 0.008), (0.78 * r, top), (0, top)], 24
        )
        cap = at(cylinder(self.cap_radius, self.cap, 20, 0.0015), (0, 0, top))
        label = band(r + 0.0004, 0.14 * top, 0.74 * top, 24)
        image = print_texture("white", self.ink, "product", self.brand, self.seed)
        return Shape(
            visual=(
                (body, plastic(self.colour)),
                (cap, plastic(self.cap_colour)),
                (label, printed(image)),
            ),
            collision=cylinder_collider(r, 0, top - 0.004)
            + cylinder_collider(0.78 * r, 0, top)
            + cylinder_collider(self.cap_radius, top, self.height),
            mass=600 * np.pi * r * r * self.height,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, top = self.radius, self.height - self.cap
        outline = [
            (r, 0.0),
            (r, top - 0.006),
            (self.cap_radius, top),
            (self.cap_radius, self.height),
        ]
        return standing(
            self.height,
            side_pinches(r, (0.5 * top, top - 0.014), outline=outline),
            middle=mark(0, 0, top / 2),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"cap": self.cap_colour}

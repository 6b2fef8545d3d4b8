"""A short food can with a paper label."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import metal, print_texture, printed
from pipeline.world.objects.colliders import disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import band, revolve
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import TALL, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape

CONTENTS = ("TOMATO", "BEANS", "SOUP", "CORN", "PEAS", "CURRY", "PESTO", "CHILI")


@register("sauce_can")
@dataclass(frozen=True)
class SauceCan(Parametric):
    colour: str = one_of(COLOURS)
    radius: float = between(0.027, 0.033)
    height: float = between(0.07, 0.10, size=TALL)
    label: float = between(0.72, 0.9)  # share of the height that the label covers
    ink: str = one_of(COLOURS, other_than="colour")
    content: str = one_of(CONTENTS)
    seed: int = texture()

    def shape(self) -> Shape:
        r, h, edge = self.radius, self.height, 0.5 * (1 - self.label) * self.height
        body = revolve(
            [(0, 0), (r, 0), (r, h), (0.93 * r, h), (0.9 * r, h - 0.003), (0, h - 0.003)], 24
        )
        ribs = revolve(
            [
                (0.45 * r, h - 0.003),
                (0.45 * r, h - 0.0018),
                (0.4 * r, h - 0.0018),
                (0.4 * r, h - 0.003),
            ],
            20,
        )
        label = band(r + 0.0004, edge, h - edge, 24)
        image = print_texture(self.colour, self.ink, "product", self.content, self.seed)
        return Shape(
            visual=((body, metal()), (ribs, metal()), (label, printed(image, 0.6))),
            collision=disc(r, h),
            mass=0.8 * 1050 * np.pi * r * r * h,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        return standing(
            h,
            side_pinches(r, (0.5 * h, h - 0.022), outline=[(r, 0.0), (r, h)]),
            middle=mark(0, 0, h / 2),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {
            "content": "tomatoes" if self.content == "TOMATO" else self.content.lower()
        }

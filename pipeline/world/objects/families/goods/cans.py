"""A drink can and a food can."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import metal, print_texture, printed, wrapped
from pipeline.world.objects.colliders import cylinder_collider, disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, band, box, revolve
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import BRANDS, COLOURS, mark, standing
from pipeline.world.objects.parameters import TALL, Parametric, between, one_of, texture
from pipeline.world.shapes import Shape


@register("can")
@dataclass(frozen=True)
class Can(Parametric):
    """A drink can."""

    colour: str = one_of(COLOURS)
    radius: float = between(0.026, 0.033)
    height: float = between(0.085, 0.125, size=TALL)
    ink: str = one_of(COLOURS, other_than="colour")
    style: str = one_of(("product", "stripes", "diamond", "dots"))  # print
    brand: str = one_of(BRANDS)
    seed: int = texture()

    def shape(self) -> Shape:
        r, h = self.radius, self.height
        bottom = [(0, 0.002), (0.72 * r, 0.002), (0.78 * r, 0), (r, 0.008)]
        lid = [(r, h - 0.010), (0.84 * r, h), (0.8 * r, h - 0.003), (0, h - 0.003)]
        side = band(r + 0.0003, 0.008, h - 0.010, 24)
        tab = at(box(0.009, 0.005, 0.0006), (0.3 * r, 0, h - 0.0020))
        return Shape(
            visual=(
                (
                    revolve([*bottom, *lid], 24),
                    wrapped("turned", "silver", self.seed, 0.4, metallic=0.8),
                ),
                (
                    side,
                    printed(
                        print_texture(self.colour, self.ink, self.style, self.brand, self.seed),
                        roughness=0.3,
                    ),
                ),
                (tab, metal()),
            ),
            collision=disc(0.8 * r, 0.008)
            + cylinder_collider(r, 0.006, h - 0.008)
            + disc(0.84 * r, 0.01, h - 0.01),
            mass=0.75 * 1000 * np.pi * r * r * h,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        outline = [(0.8 * r, 0.0), (r, 0.008), (r, h - 0.01), (0.84 * r, h)]
        return standing(
            h, side_pinches(r, (0.5 * h, h - 0.026), outline=outline), middle=mark(0, 0, h / 2)
        )


CONTENTS = ("TOMATO", "BEANS", "SOUP", "CORN", "PEAS", "CURRY", "PESTO", "CHILI")


@register("sauce_can")
@dataclass(frozen=True)
class SauceCan(Parametric):
    """A short food can with a paper label."""

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

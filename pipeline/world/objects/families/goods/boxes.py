"""Printed boxes (playing cards, tea, coffee) and a bar of soap."""

from typing import Any

import numpy as np

from pipeline.world.looks.materials import print_texture, printed, shaded, srgb
from pipeline.world.shapes import Material, Shape

from ...colliders import convex_collider, slab
from ...contract import NamedFrames, register
from ...geometry import at, box, decal, rounded_rectangle, stack, stacked, upright
from ...grasping import box_pinches
from ...kit import (
    BRANDS,
    COLOURS,
    LARGE,
    PASTELS,
    TALL,
    Parametric,
    between,
    mark,
    one_of,
    standing,
    texture,
)

STYLES = ("label", "stripes", "dots", "diamond")
TEA = (0.08, 0.11)
COFFEE = (0.105, 0.145)


def carton(half: tuple[float, float, float], *design: Any, bevel: float = 0.0008) -> tuple:
    image = printed(print_texture(*design), 0.55)
    return at(box(*half, bevel), (0, 0, half[2])), image


@register("playing_cards")
class PlayingCards(Parametric):
    """A boxed deck lying flat, its long side along y."""

    noun = "card deck"

    colour: str = one_of(COLOURS)
    hx: float = between(0.028, 0.033)
    length: float = between(0.080, 0.092)
    height: float = between(0.019, 0.027, size=("thin", "medium-sized", "thick"))
    ink: str = one_of(COLOURS, other_than="colour")
    style: str = one_of(STYLES)
    brand: str = one_of(BRANDS)
    seed: int = texture()

    def shape(self) -> Shape:
        hx, hy, hz = self.hx, self.length / 2, self.height / 2
        design = self.colour, self.ink, self.style, self.brand, self.seed
        body = carton((hx, hy, hz), *design)
        return Shape((body,), slab(hx, hy, self.height), mass=0.1, friction=0.5)

    def frames(self) -> NamedFrames:
        half = self.hx, self.length / 2, self.height / 2
        return standing(self.height, box_pinches(*half, axes="x"))


@register("tea_box")
class TeaBox(Parametric):
    colour: str = one_of(COLOURS)
    hx: float = between(0.026, 0.033)
    hy: float = between(0.026, 0.034)
    height: float = between(*TEA, size=TALL)
    ink: str = one_of(COLOURS, other_than="colour")
    style: str = one_of(STYLES)
    seed: int = texture()

    def shape(self) -> Shape:
        hx, hy, hz = self.hx, self.hy, self.height / 2
        code = printed(print_texture("white", "black", "qr", "", self.seed), 0.6)
        size, out = 0.8 * min(hx, hy), 0.0004
        places = (0, -hy - out), (hx + out, 0), (0, hy + out), (-hx - out, 0)
        sides = ((x, y, self.code_height) for x, y in places)
        codes = [(decal(size, size, at, upright(k)), code) for k, at in enumerate(sides)]
        body = carton((hx, hy, hz), self.colour, self.ink, self.style, "TEA", self.seed)
        pieces = slab(hx, hy, self.height)
        return Shape((body, *codes), pieces, mass=0.12, friction=0.5)

    @property
    def code_height(self) -> float:
        return 0.25 * self.height

    def frames(self) -> NamedFrames:
        z, hx, hy = self.code_height, self.hx, self.hy
        return standing(
            self.height,
            box_pinches(hx, hy, self.height / 2),
            front=mark(0, -hy, z, (0, -1, 0)),
            back=mark(0, hy, z, (0, 1, 0)),
            right=mark(hx, 0, z, (1, 0, 0), (0, 1, 0)),
            left=mark(-hx, 0, z, (-1, 0, 0), (0, 1, 0)),
        )


@register("coffee_box")
class CoffeeBox(Parametric):
    colour: str = one_of(COLOURS)
    hx: float = between(0.038, 0.05)
    hy: float = between(0.026, 0.033)
    height: float = between(*COFFEE, size=TALL)
    ink: str = one_of(COLOURS, other_than="colour")
    style: str = one_of(STYLES)
    brand: str = one_of(("COFFEE", "MOCHA", "ROAST", "BEANS", "LATTE"))
    seed: int = texture()

    def shape(self) -> Shape:
        hx, hy, hz, seed = self.hx, self.hy, self.height / 2, self.seed
        fold = at(box(0.98 * hx, 0.004, 0.0035), (0, 0, 2 * hz - 0.0035))
        design = (self.colour, self.ink, self.style, self.brand, seed)
        stripes = printed(print_texture(self.ink, self.colour, "stripes", "", seed))
        body = carton((hx, hy, hz - 0.0025), *design, bevel=0.002)
        pieces = slab(hx, hy, self.height)
        return Shape((body, (fold, stripes)), pieces, mass=0.28, friction=0.5)

    def frames(self) -> NamedFrames:
        return standing(self.height, box_pinches(self.hx, self.hy, self.height / 2, axes="y"))


ROUND = (
    (0.0, 0.86, 0.82), (0.06, 0.93, 0.91), (0.16, 0.985, 0.98), (0.30, 1.0, 1.0), (0.64, 1.0, 1.0),
    (0.80, 0.98, 0.97), (0.91, 0.94, 0.91), (0.975, 0.88, 0.84), (1.0, 0.82, 0.78),
)  # fmt: skip
LEVELS = ((0.0, 0.9, 0.86), (0.22, 1.0, 1.0), (0.72, 1.0, 1.0), (0.93, 0.93, 0.9), (1.0, 0.84, 0.8))


@register("soap")
class Soap(Parametric):
    length: float = between(0.072, 0.095, size=LARGE)
    half: float = between(0.024, 0.031)
    height: float = between(0.026, 0.034)
    corner: float = between(0.3, 1.0)  # roundness of the outline, as a share of the half width
    stamp: float = between(0.4, 0.65)  # share of the top that is embossed
    colour: str = one_of(PASTELS + COLOURS)

    def shape(self) -> Shape:
        a, b, h, corner = self.length / 2, self.half, self.height, self.corner * self.half
        ink = shaded(self.colour, 0.72)
        pressed = printed(print_texture(self.colour, ink, "pressed", "SOAP"), 0.3)
        size = 1.3 * self.stamp * self.length, 1.3 * self.stamp * self.half
        bar = stack(rounded_rectangle(a, b, corner, 9), ROUND * np.array([h, 1, 1]), 60)
        levels = [(z * h, x, y) for z, x, y in LEVELS]
        rings = stacked(rounded_rectangle(a, b, corner, 4), levels)
        skin = Material(srgb(self.colour), roughness=0.3)
        return Shape(
            ((bar, skin), (decal(*size, (0, 0, h + 0.0002)), pressed)),
            convex_collider(rings.reshape(-1, 3)),
            mass=1000 * self.length * 2 * self.half * self.height * 0.85,
            friction=0.4,
        )

    def frames(self) -> NamedFrames:
        half = self.length / 2, self.half, self.height / 2
        return standing(self.height, box_pinches(*half, axes="y", offsets=(-0.2, 0.0, 0.2)))

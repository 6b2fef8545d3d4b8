"""Flat things to set others on."""

from typing import Self

import numpy as np
from numpy.random import Generator

from pipeline.world.looks.materials import (
    fabric,
    made_of,
    painted,
    print_texture,
    printed,
    worn,
    wrapped,
)
from pipeline.world.shapes import Shape, seen_along

from ...colliders import disc, slab
from ...contract import NamedFrames, register
from ...geometry import at, cylinder, extrude, revolve, rounded_rectangle
from ...kit import (
    COLOURS,
    LARGE,
    Parametric,
    between,
    mark,
    one_of,
    other,
    pick,
    seed,
    size_word,
    standing,
    texture,
)

MAT = (0.10, 0.17)
TONES = {"wood": ("oak", "walnut", "beech", "mahogany"), "rubber": COLOURS, "painted": COLOURS}


@register("coaster")
class Coaster(Parametric):
    material: str = one_of(tuple(TONES))
    colour: str = one_of(TONES, by="material")
    radius: float = between(0.042, 0.055, size=LARGE)
    thickness: float = between(0.004, 0.007)
    form: str = one_of(("round", "square"))
    ring: str = one_of(COLOURS, other_than="colour")
    seed: int = texture()

    def shape(self) -> Shape:
        r, t, pieces = self.radius, self.thickness, disc(self.radius, self.thickness)
        body, top = cylinder(r, t, 28, 0.001), t + 0.0004
        if self.form == "square":
            body = extrude(rounded_rectangle(r, r, 0.15 * r, 3), t, 0.001)
            pieces = slab(r, r, t)
        ring = revolve([(0.85 * r, t), (0.85 * r, top), (0.7 * r, top), (0.7 * r, t)], 28)
        skin = made_of(self.material, self.colour, self.seed)
        visual = (body, skin), (ring, painted(self.ring))
        return Shape(visual, pieces, mass=700 * np.pi * r * r * t, friction=0.7)

    def frames(self) -> NamedFrames:
        return standing(self.thickness, centre=mark(0, 0, self.thickness))


@register("mat")
class Mat(Parametric):
    """A rectangular cloth mat with a border."""

    hx: float
    hy: float
    thickness: float
    colour: str
    border: str
    seed: int

    @classmethod
    def draw(  # pyright: ignore[reportIncompatibleMethodOverride]
        cls, rng: Generator, half: tuple[float, float] | None = None, colour: str = ""
    ) -> Self:
        """Draw a mat; half extents `half` (m) and `colour` may be given."""
        drawn, tone = (rng.uniform(*MAT), rng.uniform(0.06, 0.09)), pick(rng, COLOURS)
        tone = colour or tone
        hx, hy = half or drawn
        return cls(hx, hy, rng.uniform(0.003, 0.005), tone, other(rng, COLOURS, tone), seed(rng))

    def shape(self) -> Shape:
        hx, hy, t = self.hx, self.hy, self.thickness
        edge = extrude(rounded_rectangle(hx, hy, 0.006, 2), t)
        inner = extrude(rounded_rectangle(hx - 0.008, hy - 0.008, 0.004, 2), 0.0006)
        size = (2 * hx - 0.016, 2 * hy - 0.016)
        inner = seen_along(at(inner, (0, 0, t - 0.0002)), np.eye(2, 3), size)
        skin = wrapped("runner", self.colour, self.seed, 0.95, 256)
        visual = (edge, fabric(self.border)), (inner, skin)
        return Shape(visual, slab(hx, hy, t), mass=600 * 4 * hx * hy * t, friction=0.9)

    def frames(self) -> NamedFrames:
        return standing(self.thickness, centre=mark(0, 0, self.thickness))

    def facts(self) -> dict[str, str]:
        return super().facts() | {"size": size_word(self.hx, MAT)}


HALF = (0.045, 0.075)
PAD_SKINS = ("fabric", "rubber", "painted")


@register("pad")
class Pad(Parametric):
    hx: float
    hy: float
    thickness: float
    corner: float
    material: str
    colour: str
    seed: int

    @classmethod
    def draw(  # pyright: ignore[reportIncompatibleMethodOverride]
        cls,
        rng: Generator,
        half: tuple[float, float] | None = None,
        thickness: float | None = None,
        colour: str = "",
    ) -> Self:
        """Draw a pad; half extents `half` (m), `thickness` (m) and `colour` may be given."""
        drawn = (rng.uniform(*HALF), rng.uniform(*HALF))
        hx, hy = half or drawn
        return cls(
            hx,
            hy,
            rng.uniform(0.004, 0.007) if thickness is None else thickness,
            rng.uniform(0.001, 0.2) * min(hx, hy),
            pick(rng, PAD_SKINS),
            colour or pick(rng, COLOURS),
            seed(rng),
        )

    def shape(self) -> Shape:
        hx, hy, t = self.hx, self.hy, self.thickness
        bevel = min(0.001, 0.3 * t)
        corner = max(self.corner, 2 * bevel)  # the chamfer of a tighter corner turns inside out
        mesh = extrude(rounded_rectangle(hx, hy, corner, 3), t, bevel)
        skin = {
            "fabric": printed(print_texture(self.colour, "cream", "hem", seed=self.seed), 0.95),
            "rubber": worn(self.colour, self.seed, 0.9),
            "painted": worn(self.colour, self.seed),
        }[self.material]
        return Shape(((mesh, skin),), slab(hx, hy, t), mass=900 * 4 * hx * hy * t, friction=0.8)

    def frames(self) -> NamedFrames:
        return standing(self.thickness, centre=mark(0, 0, self.thickness))

    def facts(self) -> dict[str, str]:
        size = size_word(self.hx * self.hy, (HALF[0] ** 2, HALF[1] ** 2))
        return super().facts() | {"size": size}

"""A display stand: a plate on a column on a foot."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.materials import glaze, metal, painted, wood
from pipeline.world.objects.colliders import box_collider, cylinder_collider, disc
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.geometry import at, cylinder, extrude, revolve, rounded_rectangle
from pipeline.world.objects.kit import COLOURS, mark, pick, seed, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

RADIUS = (0.055, 0.075)


@register("display_stand")
@dataclass(frozen=True)
class DisplayStand(Family):
    radius: float  # of the plate; half extent of a square one
    height: float
    foot: float
    column: float
    plate: float  # thickness
    form: str
    material: str
    colour: str
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        radius, material = rng.uniform(*RADIUS), pick(rng, ("wood", "metal", "painted", "ceramic"))
        tones = {"wood": ("oak", "walnut", "pine", "birch"), "metal": ("silver", "gold", "charcoal")}.get(material, COLOURS)
        return cls(
            radius,
            rng.uniform(0.045, 0.085),
            radius * rng.uniform(0.75, 0.95),
            radius * rng.uniform(0.2, 0.45),
            rng.uniform(0.007, 0.012),
            pick(rng, ("round", "square")),
            material,
            pick(rng, tones),
            seed(rng),
        )

    def shape(self) -> Shape:
        r, h, f, c, t = self.radius, self.height, self.foot, self.column, self.plate
        skin = {"wood": wood(self.colour, self.seed), "metal": metal(self.colour), "ceramic": glaze(self.colour)}.get(self.material)
        skin = painted(self.colour) if skin is None else skin
        column = revolve([(f, 0), (f, 0.006), (c, 0.02), (0.8 * c, 0.5 * h), (c, h - t)], 24, 60)
        under = revolve([(0, 0), (f, 0)], 24)
        plate = cylinder(r, t, 28, 0.0015) if self.form == "round" else extrude(rounded_rectangle(r, r, 0.1 * r, 3), t, 0.0015)
        top = disc(r, t, h - t) if self.form == "round" else box_collider(r, r, t / 2, (0, 0, h - t / 2))
        return Shape(
            visual=((under, skin), (column, skin), (at(plate, (0, 0, h - t)), skin)),
            collision=disc(f, 0.012) + cylinder_collider(c, 0.01, h - t) + top,
            mass=0.5,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        top = mark(0, 0, self.height)
        return NamedFrames({"base": mark(0, 0, 0), "top": top, "centre": top})

    def words(self) -> Words:
        return describe(
            "display_stand",
            "display stand",
            colour=self.colour,
            size=size_word(self.radius, RADIUS),
            material="wooden" if self.material == "wood" else self.material,
            plain="" if self.material == "wood" else self.material,
            form=self.form,
        )

"""Bins, all hollow: a small one for the table, and two that stand on the floor beside it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.materials import metal, plastic
from pipeline.world.objects.colliders import box_collider, disc, ring_of_boxes, walls_of_boxes
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.families.basket import open_box
from pipeline.world.objects.geometry import at, box, revolve, rounded_rectangle, sweep
from pipeline.world.objects.grasping import rim_pinches
from pipeline.world.objects.kit import COLOURS, mark, other, pick, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

SMALL = (0.05, 0.065)
ROUND = (0.19, 0.22)
SQUARE = (0.18, 0.22)


@register("table_bin")
@dataclass(frozen=True)
class TableBin(Family):
    """Round and tapered, with a rim."""

    radius: float  # at the rim
    foot: float
    height: float
    material: str
    colour: str
    stripe: str

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        radius, material = rng.uniform(*SMALL), pick(rng, ("plastic", "metal"))
        colour = pick(rng, COLOURS)
        return cls(radius, radius * rng.uniform(0.72, 0.9), rng.uniform(0.1, 0.135), material, colour, other(rng, COLOURS, colour))

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, 0.004
        skin = plastic if self.material == "plastic" else metal
        outside = revolve([(0, 0), (f, 0), (r, h), (r - wall, h)], 26)
        inside = revolve([(r - wall, h), (f - wall, wall), (0, wall)], 26)
        lip = revolve([(r - 0.0005, h - 0.006), (r + 0.002, h - 0.006), (r + 0.002, h), (r - 0.001, h + 0.0005)], 26)
        stripe = revolve([(f + (r - f) * s + 0.0005, h * s) for s in (0.2, 0.45)], 26)
        return Shape(
            visual=(
                (outside, skin(self.colour)),
                (inside, plastic("charcoal")),
                (lip, skin(self.stripe)),
                (stripe, skin(self.stripe)),
            ),
            collision=disc(f, wall) + ring_of_boxes(f, wall, h, 16, top=r),
            mass=1100 * wall * np.pi * (f * f + (f + r) * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        floor = mark(0, 0, 0.004)
        flare = float(np.degrees(np.arctan2(self.radius - self.foot, self.height)))
        points = {"base": mark(0, 0, 0), "top": mark(0, 0, self.height), "inside": floor, "centre": floor}
        return NamedFrames(points, rim_pinches(self.radius, 0.004, self.height, 0.015, flare=flare, pitches=(30, 45, 60, 75, 90)))

    def words(self) -> Words:
        return describe(
            "table_bin",
            "table bin",
            colour=self.colour,
            size=size_word(self.radius, SMALL),
            material=self.material,
            stripe=self.stripe,
        )


@register("dustbin")
@dataclass(frozen=True)
class Dustbin(Family):
    """A round bin on the floor, open at the top."""

    radius: float
    foot: float
    height: float
    colour: str
    rim: str

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        radius, colour = rng.uniform(*ROUND), pick(rng, COLOURS)
        return cls(radius, radius * rng.uniform(0.82, 0.95), rng.uniform(0.5, 0.62), colour, other(rng, COLOURS, colour))

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, 0.008
        outside = revolve([(0, 0), (f, 0), (r, h), (r - wall, h)], 32)
        inside = revolve([(r - wall, h), (f - wall, wall), (0, wall)], 32)
        rim = revolve([(r - 0.002, h - 0.03), (r + 0.004, h - 0.03), (r + 0.004, h), (r - wall, h + 0.001)], 32)
        return Shape(
            visual=((outside, plastic(self.colour)), (inside, plastic("charcoal")), (rim, plastic(self.rim))),
            collision=disc(f, wall) + ring_of_boxes(f, wall, h, 20, top=r),
            mass=2.5,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        floor = mark(0, 0, 0.008)
        return NamedFrames({"base": mark(0, 0, 0), "top": mark(0, 0, self.height), "inside": floor, "centre": floor})

    def words(self) -> Words:
        return describe(
            "dustbin",
            "dustbin",
            colour=self.colour,
            size=size_word(self.radius, ROUND, ("narrow", "medium-sized", "wide")),
            rim=self.rim,
        )


@register("big_bin")
@dataclass(frozen=True)
class BigBin(Family):
    """A rectangular bin on the floor, open at the top."""

    hx: float
    hy: float
    height: float
    corner: float
    colour: str
    rim: str

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        colour = pick(rng, COLOURS)
        return cls(
            rng.uniform(*SQUARE),
            rng.uniform(0.2, 0.27),
            rng.uniform(0.46, 0.58),
            rng.uniform(0.02, 0.06),
            colour,
            other(rng, COLOURS, colour),
        )

    def shape(self) -> Shape:
        wall = 0.01
        body = open_box(self.hx, self.hy, self.height, wall, self.corner)
        ring = rounded_rectangle(self.hx - 0.002, self.hy - 0.002, self.corner, 4)
        rim = sweep(np.column_stack([ring, np.full(len(ring), self.height - 0.004)]), 0.008, 6, closed=True)
        plate = at(box(0.4 * self.hx, 0.001, 0.05, 0.0), (0, -self.hy - 0.001, 0.72 * self.height))
        return Shape(
            visual=((body, plastic(self.colour)), (rim, plastic(self.rim)), (plate, plastic(self.rim))),
            collision=(
                *box_collider(self.hx, self.hy, wall / 2, (0, 0, wall / 2)),
                *walls_of_boxes(self.hx, self.hy, wall, self.height),
            ),
            mass=3.5,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        floor = mark(0, 0, 0.01)
        return NamedFrames({"base": mark(0, 0, 0), "top": mark(0, 0, self.height), "inside": floor, "centre": floor})

    def words(self) -> Words:
        return describe(
            "big_bin",
            "big bin",
            colour=self.colour,
            size=size_word(self.height, (0.46, 0.58), ("low", "medium-sized", "tall")),
            rim=self.rim,
        )

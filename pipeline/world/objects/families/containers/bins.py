"""Bins, all hollow: a small one for the table, and two that stand on the floor beside it."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import metal, plastic
from pipeline.world.objects.colliders import tray, vessel
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.families.containers.baskets import open_box
from pipeline.world.objects.geometry import at, box, revolve, rounded_rectangle, sweep, tapered
from pipeline.world.objects.grasping import rim_pinches
from pipeline.world.objects.kit import COLOURS, hollow, lean
from pipeline.world.objects.parameters import LARGE, WIDE, Parametric, between, one_of
from pipeline.world.shapes import Shape


@register("table_bin")
@dataclass(frozen=True)
class TableBin(Parametric):
    """Round and tapered, with a rim."""

    radius: float = between(0.05, 0.065, size=LARGE)  # at the rim
    material: str = one_of(("plastic", "metal"))
    colour: str = one_of(COLOURS)
    foot: float = between(0.72, 0.9, of="radius")
    height: float = between(0.1, 0.135)
    stripe: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, 0.004
        skin = plastic if self.material == "plastic" else metal
        outside, inside = tapered(f, r, h, wall, 26)
        lip = revolve(
            [
                (r - 0.0005, h - 0.006),
                (r + 0.002, h - 0.006),
                (r + 0.002, h),
                (r - 0.001, h + 0.0005),
            ],
            26,
        )
        stripe = revolve([(f + (r - f) * s + 0.0005, h * s) for s in (0.2, 0.45)], 26)
        return Shape(
            visual=(
                (outside, skin(self.colour)),
                (inside, plastic("charcoal")),
                (lip, skin(self.stripe)),
                (stripe, skin(self.stripe)),
            ),
            collision=vessel(f, wall, h, 16, r),
            mass=1100 * wall * np.pi * (f * f + (f + r) * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        flare = lean(self.radius - self.foot, self.height)
        return hollow(
            self.height,
            0.004,
            rim_pinches(
                self.radius, 0.004, self.height, 0.015, flare=flare, pitches=(30, 45, 60, 75, 90)
            ),
        )


@register("dustbin")
@dataclass(frozen=True)
class Dustbin(Parametric):
    """A round bin on the floor, open at the top."""

    radius: float = between(0.19, 0.22, size=WIDE)
    colour: str = one_of(COLOURS)
    foot: float = between(0.82, 0.95, of="radius")
    height: float = between(0.5, 0.62)
    rim: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, 0.008
        outside, inside = tapered(f, r, h, wall, 32)
        rim = revolve(
            [(r - 0.002, h - 0.03), (r + 0.004, h - 0.03), (r + 0.004, h), (r - wall, h + 0.001)],
            32,
        )
        return Shape(
            visual=(
                (outside, plastic(self.colour)),
                (inside, plastic("charcoal")),
                (rim, plastic(self.rim)),
            ),
            collision=vessel(f, wall, h, 20, r),
            mass=2.5,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        return hollow(self.height, 0.008)


@register("big_bin")
@dataclass(frozen=True)
class BigBin(Parametric):
    """A rectangular bin on the floor, open at the top."""

    colour: str = one_of(COLOURS)
    hx: float = between(0.18, 0.22)
    hy: float = between(0.2, 0.27)
    height: float = between(0.46, 0.58, size=("low", "medium-sized", "tall"))
    corner: float = between(0.02, 0.06)
    rim: str = one_of(COLOURS, other_than="colour")

    def shape(self) -> Shape:
        wall = 0.01
        body = open_box(self.hx, self.hy, self.height, wall, self.corner)
        ring = rounded_rectangle(self.hx - 0.002, self.hy - 0.002, self.corner, 4)
        rim = sweep(
            np.column_stack([ring, np.full(len(ring), self.height - 0.004)]), 0.008, 6, closed=True
        )
        plate = at(box(0.4 * self.hx, 0.001, 0.05, 0.0), (0, -self.hy - 0.001, 0.72 * self.height))
        return Shape(
            visual=(
                (body, plastic(self.colour)),
                (rim, plastic(self.rim)),
                (plate, plastic(self.rim)),
            ),
            collision=(*tray(self.hx, self.hy, wall, self.height),),
            mass=3.5,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        return hollow(self.height, 0.01)

"""A cup without handle: a tumbler of plastic, ceramic or metal."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import glaze, metal, plastic
from pipeline.world.objects.colliders import disc, ring_of_boxes
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import revolve
from pipeline.world.objects.grasping import rim_pinches, side_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.objects.surface import join
from pipeline.world.shapes import Shape

WALL = 0.003
BANDS = (0.56, 0.575), (0.62, 0.76), (0.805, 0.82)  # shares of the height
SKINS = {"plastic": (plastic, 1000.0), "ceramic": (glaze, 2300.0), "metal": (metal, 4000.0)}


@register("cup")
@dataclass(frozen=True)
class Cup(Parametric):
    radius: float = between(0.028, 0.034, size=LARGE)  # at the rim
    material: str = one_of(tuple(SKINS))
    colour: str = one_of(COLOURS)
    foot: float = between(0.74, 0.98, of="radius")  # at the base
    height: float = between(2.4, 3.2, of="radius")
    stripe: str = one_of(COLOURS, other_than="colour")  # colour of the band round it

    def shape(self) -> Shape:
        r, f, h = self.radius, self.foot, self.height
        skin, density = SKINS[self.material]
        foot = [(0, 0.002), (f - 0.006, 0.002), (f - 0.004, 0), (f - 0.0015, 0), (f, 0.002)]
        lip = [
            (r - 0.0002, h - 0.004),
            (r + 0.0006, h - 0.003),
            (r + 0.0007, h - 0.0012),
            (r - 0.0005, h),
        ]
        hollow = [
            (r - 0.0022, h - 0.0003),
            (r - WALL, h - 0.002),
            (f - WALL, WALL + 0.005),
            (f - WALL - 0.005, WALL),
            (0, WALL),
        ]
        body = revolve([*foot, *lip, *hollow], 26)
        bands = [revolve([(f + (r - f) * s + 0.0004, h * s) for s in band], 26) for band in BANDS]
        return Shape(
            visual=((body, skin(self.colour)), (join(*bands), plastic(self.stripe))),
            collision=disc(f, WALL) + ring_of_boxes(f, WALL, h, 16, top=r),
            mass=density * WALL * np.pi * (f**2 + (f + r) * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, f, h = self.radius, self.foot, self.height
        outline = [(f, 0.0), (r, h)]
        flare = float(np.degrees(np.arctan2(r - f, h)))
        side = [
            g for s in (0.5, 0.72) for g in side_pinches(f + (r - f) * s, s * h, outline=outline)
        ]
        floor = mark(0, 0, WALL)
        return standing(
            h, (*side, *rim_pinches(r, WALL, h, flare=flare)), inside=floor, centre=floor
        )

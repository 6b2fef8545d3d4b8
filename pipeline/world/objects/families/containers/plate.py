"""A dinner plate: a flat floor with a raised rim."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import glaze
from pipeline.world.objects.colliders import disc, ring_of_boxes
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import revolve
from pipeline.world.objects.grasping import rim_pinches
from pipeline.world.objects.kit import COLOURS, PASTELS, mark
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape

WALL = 0.005


@register("plate")
@dataclass(frozen=True)
class Plate(Parametric):
    radius: float = between(0.085, 0.12, size=LARGE)
    colour: str = one_of(PASTELS + COLOURS)
    height: float = between(0.016, 0.024)
    well: float = between(0.58, 0.72, of="radius")  # radius of the flat floor
    rim_colour: str = one_of(COLOURS, also="colour")

    def shape(self) -> Shape:
        r, h, w = self.radius, self.height, self.well
        knee = WALL + 0.3 * (h - WALL)
        under = [(0, 0), (w, 0), (0.6 * w + 0.4 * r, 0.35 * (h - WALL)), (r, h - WALL)]
        inner_start = 0.985 * r
        body = revolve(
            [
                *under,
                (r, h),
                (inner_start, h),
                (0.6 * w + 0.4 * r, knee + 0.12 * h),
                (w, WALL),
                (0, WALL),
            ],
            36,
            crease=50,
        )
        middle = 0.6 * w + 0.4 * r
        fall = (inner_start - 0.92 * r) / (inner_start - middle) * (h - knee - 0.12 * h)
        edge = [
            (r + 0.0008, h - WALL),
            (r + 0.0008, h + 0.0008),
            (inner_start, h + 0.0008),
            (0.92 * r, h - fall + 0.0008),
        ]
        ring = revolve(edge, 36)
        line = revolve(
            [(1.06 * w, WALL + 0.04 * h + 0.0012), (1.02 * w, WALL + 0.01 * h + 0.0012)], 36
        )
        return Shape(
            visual=(
                (body, glaze(self.colour)),
                (ring, glaze(self.rim_colour)),
                (line, glaze(self.rim_colour)),
            ),
            collision=disc(w, WALL) + ring_of_boxes(w, WALL, h, 16, top=r),
            mass=2300 * np.pi * r**2 * WALL * 1.05,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        flare = float(np.degrees(np.arctan2(self.radius - self.well, self.height)))
        grasps = rim_pinches(
            self.radius, WALL, self.height, 0.010, pitches=(60, 75, 90), flare=min(flare, 60.0)
        )
        return NamedFrames(
            {"base": mark(0, 0, 0), "centre": mark(0, 0, WALL), "top": mark(0, 0, self.height)},
            grasps,
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"rim": "" if self.rim_colour == self.colour else self.rim_colour}

"""A bowl on a low foot."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.world.looks.materials import glaze
from pipeline.world.objects.colliders import disc, ring_of_boxes
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import revolve
from pipeline.world.objects.grasping import rim_pinches
from pipeline.world.objects.kit import COLOURS, PASTELS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape

WALL = 0.004


@register("bowl")
@dataclass(frozen=True)
class Bowl(Parametric):
    radius: float = between(0.052, 0.072, size=LARGE)
    colour: str = one_of(COLOURS)
    height: float = between(0.68, 0.88, of="radius")
    foot: float = between(0.48, 0.6, of="radius")  # radius of the standing ring
    # how far the wall bulges beyond a straight cone, as a share of the radius
    belly: float = between(0.08, 0.17)
    inside: str = one_of(PASTELS, also="colour")

    def outer(self) -> list[tuple[float, float]]:
        """Silhouette of the wall, (radius, z) from the foot to the rim, in three straight
        pieces."""
        share = np.array([0, 0.3, 0.65, 1.0])
        bulge = self.belly * self.radius * np.sin(np.pi * share)
        r = self.foot + (self.radius - self.foot) * share + bulge
        return [
            (float(a), float(b))
            for a, b in zip(r, 0.005 + (self.height - 0.005) * share, strict=True)
        ]

    def shape(self) -> Shape:
        outer = self.outer()
        inner = [(r - WALL, z + 0.4 * WALL) for r, z in outer[-2:0:-1]]
        lip = [(self.radius - WALL, self.height)]
        floor = (outer[0][0] * 0.85, 0.005 + WALL)
        outside = revolve([(0, 0), (self.foot, 0), *outer, *lip], 32, crease=50)
        inside = revolve([*lip, *inner, floor, (0, 0.005 + WALL)], 32, crease=50)
        tiers = tuple(
            c
            for (r0, z0), (r1, z1) in pairwise(outer)
            for c in ring_of_boxes(r0, WALL, z1 - z0, 14, z=z0, top=r1)
        )
        return Shape(
            visual=((outside, glaze(self.colour)), (inside, glaze(self.inside))),
            collision=disc(self.foot, 0.005 + WALL) + tiers,
            mass=2300 * WALL * np.pi * (self.foot**2 + (self.foot + self.radius) * self.height),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        (r0, z0), (r1, z1) = self.outer()[-2:]
        flare = float(np.degrees(np.arctan2(r1 - r0, z1 - z0)))
        floor = mark(0, 0, 0.005 + WALL)
        return standing(
            self.height,
            rim_pinches(self.radius, WALL, self.height, flare=flare),
            inside=floor,
            centre=floor,
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"inside": "" if self.inside == self.colour else self.inside}

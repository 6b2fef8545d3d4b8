"""A tomato, ripe or not, that stands on a flat underside."""

import numpy as np

from pipeline.world.looks.materials import glaze, painted
from pipeline.world.objects.colliders import disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, cylinder, revolve
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import LARGE, Parametric, between, mark, one_of, standing
from pipeline.world.shapes import Shape

SKINS = {"ripe": ("red", "maroon"), "unripe": ("green", "lime", "mint")}


@register("tomato")
class Tomato(Parametric):
    """A flattened ball with its green star."""

    ripeness: str = one_of(tuple(SKINS))
    colour: str = one_of(SKINS, by="ripeness")
    radius: float = between(0.025, 0.031, size=LARGE)
    height: float = between(1.55, 1.75, of="radius")

    def outline(self) -> np.ndarray:
        """Silhouette (K,2) of (radius, z) from the base to the top."""
        angle = np.radians(np.linspace(-70, 70, 11))
        z = np.sin(angle) / np.sin(angle[-1])
        return np.column_stack([self.radius * np.cos(angle), self.height / 2 * (1 + z)])

    def shape(self) -> Shape:
        r, h = self.radius, self.height
        skin = revolve([(0, 0), *self.outline().tolist(), (0, h - 0.002)], 24, 60.0)
        leaves = at(cylinder(0.45 * r, 0.0015, 5), (0, 0, h - 0.0005))
        stem = at(cylinder(0.08 * r, 0.006, 8), (0, 0, h - 0.0025))
        green = painted("dark green")
        return Shape(
            ((skin, glaze(self.colour)), (leaves, green), (stem, green)),
            disc(r, h),
            mass=900 * 4 / 3 * np.pi * r * r * h / 2,
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        r, h = self.radius, self.height
        grasps = side_pinches(r, max(h / 2, 0.022), outline=[(r, 0.0), (r, h)])
        return standing(h, grasps, middle=mark(0, 0, h / 2))

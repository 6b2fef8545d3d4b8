"""A kitchen pot with two loop handles, along x."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import metal, painted, plastic
from pipeline.world.objects.colliders import arc_of_capsules, disc, ring_of_boxes
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import revolve, sweep
from pipeline.world.objects.grasping import rim_pinches
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape

WALL = 0.004


@register("pot")
@dataclass(frozen=True)
class Pot(Parametric):
    radius: float = between(0.075, 0.10, size=LARGE)
    material: str = one_of(("steel", "enamel"))
    height: float = between(0.85, 1.25, of="radius")
    loop: float = between(0.028, 0.036)  # how far the handles stand out
    colour: str = one_of({"steel": ("silver", "charcoal"), "enamel": COLOURS}, by="material")
    handle_colour: str = one_of(("black", "silver", "brown", "red"))

    def loop_path(self, side: int) -> np.ndarray:
        """Axis (N,3) of the handle at +x (`side` 1) or -x (-1)."""
        angle = np.radians(np.linspace(-90, 90, 7))
        r = 0.97 * self.radius
        x = r + (self.loop - 0.005) * np.cos(angle) ** 0.6
        return np.column_stack([side * x, 0.036 * np.sin(angle), np.full(7, 0.8 * self.height)])

    def shape(self) -> Shape:
        r, h = self.radius, self.height
        skin = metal(self.colour) if self.material == "steel" else painted(self.colour)
        bolt = plastic(self.handle_colour) if self.handle_colour != "silver" else metal()
        outside = revolve(
            [
                (0, 0),
                (r - 0.006, 0),
                (r, 0.006),
                (r, h - 0.003),
                (r + 0.0025, h - 0.002),
                (r + 0.0025, h),
                (r - WALL, h),
            ],
            28,
        )
        inside = revolve([(r - WALL, h), (r - WALL, WALL), (0, WALL)], 28)
        base = revolve(
            [(r - 0.004, 0.004), (r + 0.0008, 0.0065), (r + 0.0008, 0.014), (r - 0.004, 0.0165)], 28
        )
        loops = [sweep(self.loop_path(s), 0.005, 8) for s in (1, -1)]
        capsules = [c for s in (1, -1) for c in arc_of_capsules(self.loop_path(s)[::2], 0.005)]
        return Shape(
            visual=(
                (outside, skin),
                (inside, metal("silver", seed=7)),
                (base, metal("silver")),
                (loops[0], bolt),
                (loops[1], bolt),
            ),
            collision=(*disc(r, WALL), *ring_of_boxes(r, WALL, h, 18), *capsules),
            mass=3500 * 0.003 * np.pi * (r * r + 2 * r * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        floor = mark(0, 0, WALL)
        return standing(
            self.height,
            tuple(
                g
                for g in rim_pinches(self.radius, WALL, self.height)
                if abs(g.pose[1]) > 0.6 * self.radius
            ),
            inside=floor,
            centre=floor,
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"handles": self.handle_colour}

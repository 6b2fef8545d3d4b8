"""A computer mouse, its buttons towards +y."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import rubber, wrapped
from pipeline.world.objects.colliders import ALONG_X, convex_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, cylinder, stack, stacked
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape, seen_along

LEVELS = (
    (0.0, 0.94, 0.95),
    (0.08, 1.0, 1.0),
    (0.5, 0.99, 0.985),
    (0.72, 0.94, 0.92),
    (0.9, 0.78, 0.74),
    (1.0, 0.42, 0.42),
)


@register("mouse")
@dataclass(frozen=True)
class Mouse(Parametric):
    colour: str = one_of(COLOURS)
    hx: float = between(0.027, 0.032)
    length: float = between(0.092, 0.115, size=LARGE)
    height: float = between(0.034, 0.041)
    pinch: float = between(0.0, 0.06)  # how much narrower the waist is, as a share
    wheel: str = one_of(("black", "gray", "white", "red", "cyan", "lime"), other_than="colour")

    def outline(self) -> np.ndarray:
        """Outline (20,2): an oval with a waist."""
        angle = 2 * np.pi * np.arange(20) / 20
        c, s = np.cos(angle), np.sin(angle)
        power = 0.62
        x = self.hx * np.sign(c) * np.abs(c) ** power * (1 - self.pinch * (1 - s**2))
        return np.column_stack(
            [x / (1 - self.pinch), self.length / 2 * np.sign(s) * np.abs(s) ** 0.85]
        ) * [1 - self.pinch, 1]

    def shape(self) -> Shape:
        h, hy = self.height, self.length / 2
        levels = [(z * h, x, y) for z, x, y in LEVELS]
        body = stack(self.outline(), levels, 60)
        wheel = at(cylinder(0.009, 0.006, 14), (-0.003, 0.5 * hy, 0.8 * h), ALONG_X)
        body = seen_along(body, np.eye(2, 3), np.ptp(self.outline(), axis=0))
        skin = wrapped("shell", self.colour, int(1e6 * self.length), 0.42)
        return Shape(
            visual=((body, skin), (wheel, rubber(self.wheel))),
            collision=convex_collider(stacked(self.outline(), levels).reshape(-1, 3)),
            mass=0.1,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        hx = self.hx * (1 - self.pinch)
        grasps = box_pinches(
            hx,
            self.length / 2,
            self.height / 2,
            heights=(0.014, 0.019),
            offsets=(-0.12, 0.0, 0.12),
            axes="x",
        )
        return standing(self.height, grasps)

"""Covers: a cup that stands upside down, and a lid with a knob."""

import numpy as np

from pipeline.world.looks.materials import made_of, plastic
from pipeline.world.objects.colliders import cylinder_collider, disc, ring_of_boxes
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, cylinder, revolve
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import COLOURS, LARGE, Parametric, between, one_of, standing
from pipeline.world.shapes import Shape

SHELL_WALL = 0.003


@register("shell_cup")
class ShellCup(Parametric):
    """An opaque cup upside down: it stands on its rim and hides what is under it."""

    noun = "cup"

    radius: float = between(0.029, 0.034, size=LARGE)  # of the rim, on the table
    material: str = one_of(("plastic", "ceramic"))
    colour: str = one_of(COLOURS)
    foot: float = between(0.74, 0.9, of="radius")  # at the top
    height: float = between(2.2, 2.8, of="radius")
    stripe: str = one_of(COLOURS, other_than="colour")

    def _outline(self) -> list[tuple[float, float]]:
        return [(self.radius, 0.0), (self.foot, self.height)]

    def shape(self) -> Shape:
        r, f, h, wall = self.radius, self.foot, self.height, SHELL_WALL
        outside = [(r, 0), (f, h - 0.003), (f - 0.003, h), (0, h)]
        inside = [(0, h - wall), (f - wall, h - wall), (r - wall, 0), (r, 0)]
        skin = made_of(self.material, self.colour)
        band = [(r + (f - r) * s + 0.0004, h * s) for s in (0.2, 0.34)]
        return Shape(
            (
                (revolve([*inside, *outside[1:]], 28, crease=50), skin),
                (revolve(band, 28), plastic(self.stripe)),
            ),
            disc(f, wall, h - wall) + ring_of_boxes(r, wall, h - wall, 16, top=f),
            mass=1200 * wall * np.pi * (f**2 + (f + r) * h),
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        r, f, h = self.radius, self.foot, self.height
        grasps = [
            grasp
            for s in (0.45, 0.7)
            for grasp in side_pinches(r + (f - r) * s, s * h, outline=self._outline())
        ]
        return standing(h, grasps)


@register("lid")
class Lid(Parametric):
    """A round lid with a knob to hold it by, wider than a cup."""

    radius: float = between(0.038, 0.044, size=LARGE)
    material: str = one_of(("plastic", "ceramic"))
    colour: str = one_of(COLOURS)
    thickness: float = between(0.004, 0.006)
    knob: float = between(0.009, 0.012)  # radius of the knob
    tall: float = between(0.032, 0.038)  # height of the knob
    knob_colour: str = one_of(COLOURS, other_than="colour", says="knob")

    def shape(self) -> Shape:
        r, t, k = self.radius, self.thickness, self.knob
        stem = at(cylinder(k, self.tall, 20, 0.002), (0, 0, t))
        skin = made_of(self.material, self.colour)
        return Shape(
            ((cylinder(r, t, 32, 0.001), skin), (stem, plastic(self.knob_colour))),
            disc(r, t) + cylinder_collider(k, t, t + self.tall),
            mass=900 * np.pi * (r * r * t + k * k * self.tall),
            friction=0.7,
        )

    def frames(self) -> NamedFrames:
        r, t, k = self.radius, self.thickness, self.knob
        outline = [(r, 0.0), (r, t), (k, t + 0.001), (k, t + self.tall)]
        heights = (t + self.tall - 0.012, t + self.tall - 0.008)
        grasps = side_pinches(k, heights, pitches=(30, 45, 60, 75, 90), outline=outline)
        return standing(t + self.tall, grasps)

"""A service bell: a dome on a base, rung by the button on top."""

from dataclasses import dataclass

import numpy as np

from pipeline.world.looks.materials import metal, painted, plastic
from pipeline.world.objects.colliders import convex_collider, disc, push_button
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, cylinder, revolve
from pipeline.world.objects.grasping import side_pinches
from pipeline.world.objects.kit import COLOURS, DARKS, mark
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of
from pipeline.world.shapes import Shape

COLLAR = 0.012  # m of upright wall at the foot of the dome, where it is held


@register("bell")
@dataclass(frozen=True)
class Bell(Parametric):
    radius: float = between(0.028, 0.034, size=LARGE)
    material: str = one_of(("metal", "painted"))
    colour: str = one_of({"metal": ("silver", "gold"), "painted": COLOURS}, by="material")
    dome: float = between(0.78, 0.98, of="radius")  # height of the dome
    foot: float = between(0.01, 0.015)  # height of the base
    knob: float = between(0.006, 0.009)  # radius of the button
    base_colour: str = one_of(DARKS, other_than="colour")

    @property
    def height(self) -> float:
        """To the top of the button (m)."""
        return self.foot + self.dome + 0.010

    def outline(self) -> list[tuple[float, float]]:
        """Silhouette of the dome, (radius, z) from the base up."""
        r, d, f = self.radius, self.dome, self.foot
        angle = np.radians([0, 20, 40, 60, 78])
        c = COLLAR
        return [
            (r, f),
            *((float(r * np.cos(a)), float(f + c + (d - c) * np.sin(a))) for a in angle),
            (0.0, f + d),
        ]

    def shape(self) -> Shape:
        r, f = self.radius, self.foot
        skin = metal(self.colour) if self.material == "metal" else painted(self.colour)
        foot = cylinder(0.93 * r, f, 24, bevel=0.002)
        dome = revolve([(0, f), (0.98 * r, f), *self.outline()], 24)
        stem = at(cylinder(0.0035, 0.012, 8), (0, 0, f + self.dome - 0.004))
        lip = revolve([(0.98 * r, f + 0.0004), (1.03 * r, f + 0.0016), (0.98 * r, f + 0.0032)], 24)
        knob = at(cylinder(self.knob, 0.005, 16, bevel=0.0015), (0, 0, self.height - 0.005))
        rings = [
            (rho * np.cos(a), rho * np.sin(a), z)
            for rho, z in self.outline()
            for a in np.arange(12) * np.pi / 6
            if rho > 0
        ]
        return Shape(
            visual=(
                (foot, plastic(self.base_colour)),
                (dome, skin),
                (lip, skin),
                (stem, metal()),
                (knob, metal()),
            ),
            collision=disc(0.93 * r, f)
            + convex_collider(rings)
            + push_button(self.knob, f + self.dome - 0.003, self.height),
            mass=0.25 * (r / 0.03) ** 2,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        f, d = self.foot, self.dome
        outline = [
            (self.radius, 0.0),
            *self.outline()[:-1],
            (self.knob, f + d),
            (self.knob, self.height),
        ]
        return NamedFrames(
            {
                "base": mark(0, 0, 0),
                "button": mark(0, 0, self.height),
                "top": mark(0, 0, self.height),
            },
            side_pinches(self.radius, max(0.0215, f + 0.5 * COLLAR), outline=outline, kind="dome"),
        )

    def facts(self) -> dict[str, str]:
        return super().facts() | {"base": self.base_colour}

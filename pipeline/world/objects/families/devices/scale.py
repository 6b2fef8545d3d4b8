"""An electronic kitchen scale with a display towards -y."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.world.looks.materials import glaze, metal, plastic, print_texture, printed
from pipeline.world.objects.colliders import Colliders, box_collider, disc
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.geometry import at, cylinder, decal, extrude, rounded_rectangle
from pipeline.world.objects.kit import COLOURS, mark, standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, drawn, one_of, texture
from pipeline.world.shapes import Shape


@register("scale")
@dataclass(frozen=True)
class Scale(Parametric):
    hx: float = between(0.07, 0.09, size=LARGE)
    hy: float = drawn(lambda rng, scale: scale.hx + rng.uniform(0.012, 0.026))
    body: float = between(0.018, 0.028)  # height of the body
    plate: float = between(0.82, 0.94)  # share of the width that the platter covers
    form: str = one_of(("round", "square"))
    colour: str = one_of(COLOURS)
    platter: str = one_of(("silver", "white", "charcoal", "gold"))
    digits: str = drawn(lambda rng, so_far: f"{int(rng.integers(0, 1000)):03d}g")
    seed: int = texture()

    def shape(self) -> Shape:
        r, y, z, t = self.plate * self.hx, self.hy - self.hx, self.body, 0.006
        case = extrude(rounded_rectangle(self.hx, self.hy, 0.018, 4), z, 0.003)
        platter = (
            cylinder(r, t, 32, 0.0015)
            if self.form == "round"
            else extrude(rounded_rectangle(r, r, 0.012, 3), t, 0.0015)
        )
        skin = glaze(self.platter) if self.platter == "white" else metal(self.platter)
        panel = printed(print_texture("charcoal", "lime", "panel", self.digits, self.seed), 0.25)
        display = decal(0.9 * self.hx, 1.5 * y + 0.008, (0, -self.hy + y + 0.004, z + 0.0004))
        lift = at(platter, (0, y, z))
        return Shape(
            visual=((case, plastic(self.colour)), (lift, skin), (display, panel)),
            collision=box_collider(self.hx, self.hy, z / 2, (0, 0, z / 2))
            + (
                box_collider(r, r, t / 2, (0, y, z + t / 2))
                if self.form == "square"
                else _shifted(disc(r, t, z), y)
            ),
            mass=0.5,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        z = self.body + 0.006
        return standing(z, centre=mark(0, self.hy - self.hx, z))

    def facts(self) -> dict[str, str]:
        return super().facts() | {"platter": "" if self.platter == self.colour else self.platter}


def _shifted(pieces: Colliders, y: float) -> Colliders:
    return tuple(replace(c, pose=c.pose + np.array([0, y, 0, 0, 0, 0, 0])) for c in pieces)

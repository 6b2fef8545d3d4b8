"""An electronic kitchen scale with a display towards -y."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pipeline.world.materials import glaze, metal, plastic, print_texture, printed
from pipeline.world.objects.colliders import Colliders, box_collider, disc
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.geometry import at, cylinder, decal, extrude, rounded_rectangle
from pipeline.world.objects.kit import COLOURS, mark, pick, seed, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

WIDTH = (0.07, 0.09)


@register("scale")
@dataclass(frozen=True)
class Scale(Family):
    hx: float
    hy: float
    body: float  # height of the body
    plate: float  # share of the width that the platter covers
    form: str
    colour: str
    platter: str
    digits: str
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        hx = rng.uniform(*WIDTH)
        return cls(
            hx,
            hx + rng.uniform(0.012, 0.026),
            rng.uniform(0.018, 0.028),
            rng.uniform(0.82, 0.94),
            pick(rng, ("round", "square")),
            pick(rng, COLOURS),
            pick(rng, ("silver", "white", "charcoal", "gold")),
            f"{int(rng.integers(0, 1000)):03d}g",
            seed(rng),
        )

    def shape(self) -> Shape:
        r, y, z, t = self.plate * self.hx, self.hy - self.hx, self.body, 0.006
        case = extrude(rounded_rectangle(self.hx, self.hy, 0.018, 4), z, 0.003)
        platter = cylinder(r, t, 32, 0.0015) if self.form == "round" else extrude(rounded_rectangle(r, r, 0.012, 3), t, 0.0015)
        skin = glaze(self.platter) if self.platter == "white" else metal(self.platter)
        panel = printed(print_texture("charcoal", "lime", "panel", self.digits, self.seed), 0.25)
        display = decal(
            0.9 * self.hx,
            1.5 * (self.hy - self.hx) + 0.008,
            (0, -self.hy + (self.hy - self.hx) + 0.004, z + 0.0004),
        )
        lift = at(platter, (0, y, z))
        return Shape(
            visual=((case, plastic(self.colour)), (lift, skin), (display, panel)),
            collision=box_collider(self.hx, self.hy, z / 2, (0, 0, z / 2))
            + (box_collider(r, r, t / 2, (0, y, z + t / 2)) if self.form == "square" else _shifted(disc(r, t, z), y)),
            mass=0.5,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        z = self.body + 0.006
        return NamedFrames({"base": mark(0, 0, 0), "top": mark(0, 0, z), "centre": mark(0, self.hy - self.hx, z)})

    def words(self) -> Words:
        return describe(
            "scale",
            "scale",
            colour=self.colour,
            size=size_word(self.hx, WIDTH),
            form=self.form,
            platter="" if self.platter == self.colour else self.platter,
        )


def _shifted(pieces: Colliders, y: float) -> Colliders:
    return tuple(replace(c, pose=c.pose + np.array([0, y, 0, 0, 0, 0, 0])) for c in pieces)

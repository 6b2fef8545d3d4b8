"""A remote control lying on its back, its top towards +y."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.materials import plastic, print_texture, printed
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.geometry import decal, extrude, rounded_rectangle
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, mark, other, pick, seed, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

LENGTH = (0.13, 0.185)


@register("remote")
@dataclass(frozen=True)
class Remote(Family):
    hx: float
    length: float
    thickness: float
    corner: float
    keypad: float  # share of the length covered by keys
    colour: str
    keys: str
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        hx, colour = rng.uniform(0.019, 0.026), pick(rng, COLOURS)
        return cls(
            hx,
            rng.uniform(*LENGTH),
            rng.uniform(0.018, 0.025),
            hx * rng.uniform(0.3, 0.95),
            rng.uniform(0.6, 0.85),
            colour,
            other(rng, ("white", "black", "gray", "cyan", "yellow", "beige"), colour),
            seed(rng),
        )

    def shape(self) -> Shape:
        hx, hy, t = self.hx, self.length / 2, self.thickness
        body = extrude(rounded_rectangle(hx, hy, self.corner, 5), t, bevel=0.004)
        pad = decal(1.5 * hx, 2 * self.keypad * hy, (0, (0.9 - self.keypad) * hy, t + 0.0004))
        return Shape(
            visual=(
                (body, plastic(self.colour)),
                (pad, printed(print_texture(self.colour, self.keys, "keys", "", self.seed), 0.5)),
            ),
            collision=box_collider(hx, hy, t / 2, (0, 0, t / 2)),
            mass=0.12,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        return NamedFrames(
            {"base": mark(0, 0, 0), "top": mark(0, 0, self.thickness)},
            box_pinches(self.hx, self.length / 2, self.thickness / 2, offsets=(-0.3, 0.0, 0.3), axes="x"),
        )

    def words(self) -> Words:
        return describe(
            "remote",
            "remote control",
            colour=self.colour,
            size=size_word(self.length, LENGTH, ("short", "medium-sized", "long")),
            keys=self.keys,
        )

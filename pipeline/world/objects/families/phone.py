"""A phone lying on its back, screen up, its top towards +y."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.materials import plastic, print_texture, printed
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.geometry import decal, extrude, rounded_rectangle
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, mark, pick, seed, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

HEIGHT = (0.125, 0.152)
SCREENS = ("navy", "sky blue", "lavender", "coral", "mint", "gold", "pink", "teal", "white")


@register("phone")
@dataclass(frozen=True)
class Phone(Family):
    hx: float
    height: float
    thickness: float
    corner: float
    colour: str
    screen: str
    style: str
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        return cls(
            rng.uniform(0.030, 0.034),
            rng.uniform(*HEIGHT),
            rng.uniform(0.0145, 0.018),
            rng.uniform(0.004, 0.010),
            pick(rng, COLOURS),
            pick(rng, SCREENS),
            pick(rng, ("dots", "stripes", "diamond", "panel")),
            seed(rng),
        )

    def shape(self) -> Shape:
        hx, hy, t = self.hx, self.height / 2, self.thickness
        case = extrude(rounded_rectangle(hx, hy, self.corner, 3), t, bevel=0.002)
        black = decal(1.88 * hx, 1.92 * hy, (0, 0, t + 0.0002))
        glass = decal(1.78 * hx, 1.74 * hy, (0, 0, t + 0.0004))
        accent = "white" if self.screen != "white" else "navy"
        image = print_texture(self.screen, accent, self.style, "12:45", self.seed)
        return Shape(
            visual=((case, plastic(self.colour)), (black, plastic("black")), (glass, printed(image, 0.2))),
            collision=box_collider(hx, hy, t / 2, (0, 0, t / 2)),
            mass=0.19,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        hy, t = self.height / 2, self.thickness
        return NamedFrames(
            {
                "base": mark(0, 0, 0),
                "top": mark(0, 0, t),
                "screen": mark(0, 0, t),
                "foot": mark(0, -hy, 0),  # middle of the lower edge on the back: goes to a phone stand's "seat"
            },
            box_pinches(self.hx, hy, t / 2, offsets=(0.0, 0.3, 0.55), axes="x"),
        )

    def words(self) -> Words:
        return describe("phone", "phone", colour=self.colour, size=size_word(self.height, HEIGHT), screen=self.screen)

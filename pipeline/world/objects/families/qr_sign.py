"""A payment sign facing -y: a foot and an upright board with a printed code."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.world.materials import plastic, print_texture, printed, wood
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import Family, NamedFrames, Words, register
from pipeline.world.objects.families.boxes import upright
from pipeline.world.objects.geometry import at, box, decal
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import COLOURS, mark, other, pick, seed, size_word
from pipeline.world.objects.words import describe
from pipeline.world.shapes import Shape

HEIGHT = (0.115, 0.155)


@register("qr_sign")
@dataclass(frozen=True)
class QrSign(Family):
    hx: float
    height: float
    board: float  # half thickness of the board
    foot: float  # half depth of the foot
    foot_height: float
    foot_material: str
    colour: str
    foot_colour: str
    seed: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        material, colour = pick(rng, ("wood", "plastic")), pick(rng, COLOURS)
        return cls(
            rng.uniform(0.042, 0.056),
            rng.uniform(*HEIGHT),
            rng.uniform(0.004, 0.007),
            rng.uniform(0.026, 0.034),
            rng.uniform(0.012, 0.02),
            material,
            colour,
            other(rng, ("oak", "walnut", "beech") if material == "wood" else COLOURS, colour),
            seed(rng),
        )

    def shape(self) -> Shape:
        hx, hz, f = self.hx, (self.height - self.foot_height) / 2, self.foot_height
        middle = f + hz
        skin = wood(self.foot_colour, self.seed) if self.foot_material == "wood" else plastic(self.foot_colour)
        side = 1.6 * min(hx, hz)
        code = printed(print_texture("white", "black", "qr", "", self.seed), 0.4)
        title = printed(print_texture(self.colour, "white", "label", "PAY", self.seed), 0.4)
        y = -self.board - 0.0006
        spare = 2 * hz - side
        return Shape(
            visual=(
                (at(box(hx, self.board, hz, 0.001), (0, 0, middle)), plastic(self.colour)),
                (at(box(hx + 0.004, self.foot, f / 2, 0.002), (0, 0, f / 2)), skin),
                (decal(side, side, (0, y, f + 0.35 * spare + side / 2), upright(0)), code),
                (decal(1.5 * hx, 0.5 * spare, (0, y, 2 * hz + f - 0.32 * spare), upright(0)), title),
            ),
            collision=box_collider(hx, self.board, hz, (0, 0, middle)) + box_collider(hx + 0.004, self.foot, f / 2, (0, 0, f / 2)),
            mass=0.25,
            friction=0.6,
        )

    def frames(self) -> NamedFrames:
        hz, f = (self.height - self.foot_height) / 2, self.foot_height
        grasps = box_pinches(
            self.hx,
            self.board,
            hz,
            (0, 0, f + hz),
            heights=(2 * hz - 0.02, 2 * hz - 0.03),
            axes="y",
            offsets=(-0.5, -0.25, 0.0, 0.25, 0.5),
        )
        return NamedFrames(
            {"base": mark(0, 0, 0), "top": mark(0, 0, self.height), "code": mark(0, -self.board, f + hz, (0, -1, 0))}, tuple(grasps)
        )

    def words(self) -> Words:
        return describe(
            "qr_sign",
            "QR code sign",
            colour=self.colour,
            size=size_word(self.height, HEIGHT, ("short", "medium-sized", "tall")),
            foot=self.foot_colour,
            material="wooden" if self.foot_material == "wood" else "plastic",
        )

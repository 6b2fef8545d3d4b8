"""A puzzle cube, scrambled: nine stickers on each of six sides."""

from dataclasses import dataclass

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import plastic
from pipeline.world.objects.colliders import box_collider
from pipeline.world.objects.contract import NamedFrames, register
from pipeline.world.objects.families.goods.boxes import upright
from pipeline.world.objects.geometry import at, box, decal
from pipeline.world.objects.grasping import box_pinches
from pipeline.world.objects.kit import standing
from pipeline.world.objects.parameters import LARGE, Parametric, between, one_of, texture
from pipeline.world.objects.surface import join
from pipeline.world.shapes import Shape

STICKERS = ("white", "yellow", "red", "orange", "blue", "green")


@register("rubiks_cube")
@dataclass(frozen=True)
class RubiksCube(Parametric):
    noun = "puzzle cube"

    side: float = between(0.050, 0.058, size=LARGE)
    sticker: float = between(0.8, 0.92)  # share of a cell that its sticker covers
    colour: str = one_of(("black", "charcoal", "gray"))  # of the body
    scramble: float = between(0, 1)  # share of stickers that are not of their side's colour
    seed: int = texture()

    def shape(self) -> Shape:
        h, cell = self.side / 2, self.side / 3
        rng = np.random.Generator(np.random.Philox(self.seed))
        colours = rng.permutation(6)
        chosen: dict[int, list] = {k: [] for k in range(6)}
        turns = [*(upright(k) for k in range(4)), (1, 0, 0, 0), quat_about((1, 0, 0), np.pi)]
        for face, turn in enumerate(turns):
            for k in range(9):
                tone = (
                    int(rng.integers(6))
                    if rng.uniform() < self.scramble and k != 4
                    else int(colours[face])
                )
                tile = decal(
                    self.sticker * cell,
                    self.sticker * cell,
                    ((k % 3 - 1) * cell, (k // 3 - 1) * cell, h + 0.0003),
                )
                chosen[tone].append(at(tile, (0, 0, h), turn))
        stickers = tuple(
            (join(*tiles), plastic(STICKERS[tone])) for tone, tiles in chosen.items() if tiles
        )
        return Shape(
            visual=((at(box(h, h, h, 0.0015), (0, 0, h)), plastic(self.colour)), *stickers),
            collision=box_collider(h, h, h, (0, 0, h)),
            mass=0.1,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        h = self.side / 2
        return standing(self.side, box_pinches(h, h, h, heights=(h,), offsets=(0.0,)))

    def facts(self) -> dict[str, str]:
        return super().facts() | {
            "order": "scrambled"
            if self.scramble > 0.4
            else "nearly solved"
            if self.scramble > 0.08
            else "solved"
        }

"""A cube, a tall bar, wooden forms, a puzzle cube."""

from functools import partial

import numpy as np

from pipeline.poses import quat_about
from pipeline.world.looks.materials import WOODS, painted, plastic, rubber, wood, worn
from pipeline.world.shapes import Shape

from ...colliders import disc, prism_collider, slab
from ...contract import NamedFrames, register
from ...geometry import at, box, cylinder, decal, side_prism, upright
from ...grasping import PITCHES, box_pinches, side_pinches
from ...kit import COLOURS, LARGE, Parametric, between, mark, one_of, standing, texture
from ...surface import join

SKINS = {"painted": (painted, 600.0), "plastic": (plastic, 500.0), "rubber": (rubber, 700.0)}


@register("block")
class Block(Parametric):
    side: float = between(0.044, 0.056, size=LARGE)
    bevel: float = between(0.001, 0.006)
    material: str = one_of(tuple(SKINS))
    colour: str = one_of(COLOURS)

    def shape(self) -> Shape:
        h = self.side / 2
        skin, density = SKINS[self.material]
        paint = worn(self.colour, round(self.side * 1e6), skin(self.colour).roughness)
        cube = at(box(h, h, h, self.bevel), (0, 0, h)), paint
        return Shape((cube,), slab(h, h, self.side), mass=density * self.side**3)

    def frames(self) -> NamedFrames:
        h = self.side / 2
        grasps = box_pinches(h, h, h, heights=(max(h, 0.022),), offsets=(0.0,))
        return standing(self.side, grasps, centre=mark(0, 0, self.side))


SHORT_OF_THE_MIDDLE = (0.0, 0.004, 0.008, 0.012, 0.016, 0.020)
"""Distances (m) of the tcp from the middle: the block is wide, a palm that leans needs room."""

HALF = 0.03
HEIGHT = 0.20
"""m, the same for all, as the original's."""


@register("long_block")
class LongBlock(Parametric):
    colour: str = one_of(("red", "maroon", "coral", "rust"))
    bevel: float = between(0.001, 0.005)
    band: str = one_of(COLOURS, other_than="colour")  # colour of the ring round the middle
    band_width: float = between(0.006, 0.025)

    def shape(self) -> Shape:
        w, h = HALF, HEIGHT / 2
        ring = box(w + 0.0004, w + 0.0004, self.band_width / 2)
        bar = at(box(w, w, h, self.bevel), (0, 0, h)), worn(self.colour, 5)
        visual, pieces = (bar, (at(ring, (0, 0, h)), painted(self.band))), slab(w, w, HEIGHT)
        return Shape(visual, pieces, mass=400 * 8 * w * w * h, friction=0.7)

    def frames(self) -> NamedFrames:
        w, h = HALF, HEIGHT
        grips = partial(
            box_pinches, w, w, h / 2, pitches=PITCHES, offsets=(0.0,), retreats=SHORT_OF_THE_MIDDLE
        )
        low = grips(heights=(0.035, 0.055, 0.09), kind="low")
        high = grips(heights=(h - 0.07, h - 0.05, h - 0.03), kind="high")
        return standing(h, (*low, *high), middle=mark(0, 0, h / 2))


@register("wooden_block")
class WoodenBlock(Parametric):
    form: str = one_of(("brick", "cylinder", "wedge"))
    length: float = between(0.06, 0.1, size=LARGE)  # along x; the height of a cylinder
    half: float = between(0.02, 0.031)  # half width, or radius
    height: float = between(0.036, 0.055)
    colour: str = one_of(tuple(WOODS))
    seed: int = texture()

    def wedge(self) -> np.ndarray:
        """Outline (4,2) in x and z."""
        a, h = self.length / 2, self.height
        return np.array([(-a, 0), (a, 0), (0.35 * a, h), (-0.35 * a, h)])

    def shape(self) -> Shape:
        a, b, h = self.length / 2, self.half, self.height
        if self.form == "brick":
            mesh, pieces, size = box(a, b, h / 2, 0.0025), slab(a, b, h), 4 * a * b * h * 1
            mesh = at(mesh, (0, 0, h / 2))
        elif self.form == "cylinder":
            mesh, pieces = cylinder(b, self.length, 24, 0.002), disc(b, self.length)
            size = np.pi * b * b * self.length
        else:
            mesh, pieces = side_prism(self.wedge(), b, 0.002), prism_collider(self.wedge(), b)
            size = 4 * a * b * h * 0.68
        skin = wood(self.colour, self.seed)
        return Shape(((mesh, skin),), pieces, mass=650 * size, friction=0.5)

    def frames(self) -> NamedFrames:
        a, b = self.length / 2, self.half
        if self.form == "cylinder":
            h = self.length
            return standing(h, side_pinches(b, 0.55 * h, outline=[(b, 0.0), (b, h)]))
        spread = (-0.2, 0.0, 0.2) if self.form == "brick" else (0.0,)
        return standing(self.height, box_pinches(a, b, self.height / 2, offsets=spread, axes="y"))

    def facts(self) -> dict[str, str]:
        return super().facts() | {"form": "trapezoid" if self.form == "wedge" else self.form}


STICKERS = ("white", "yellow", "red", "orange", "blue", "green")


@register("rubiks_cube")
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
        tiles: dict[int, list] = {k: [] for k in range(6)}
        turns = [*(upright(k) for k in range(4)), (1, 0, 0, 0), quat_about((1, 0, 0), np.pi)]
        for face, turn in enumerate(turns):
            for k in range(9):
                is_mixed = rng.uniform() < self.scramble and k != 4
                tone = int(rng.integers(6)) if is_mixed else int(colours[face])
                size, place = self.sticker * cell, ((k % 3 - 1) * cell, (k // 3 - 1) * cell)
                tiles[tone].append(at(decal(size, size, (*place, h + 0.0003)), (0, 0, h), turn))
        stickers = ((join(*each), plastic(STICKERS[k])) for k, each in tiles.items() if each)
        return Shape(
            ((at(box(h, h, h, 0.0015), (0, 0, h)), plastic(self.colour)), *stickers),
            slab(h, h, self.side),
            mass=0.1,
            friction=0.5,
        )

    def frames(self) -> NamedFrames:
        h = self.side / 2
        return standing(self.side, box_pinches(h, h, h, heights=(h,), offsets=(0.0,)))

    def facts(self) -> dict[str, str]:
        order = "nearly solved" if self.scramble > 0.08 else "solved"
        return super().facts() | {"order": "scrambled" if self.scramble > 0.4 else order}

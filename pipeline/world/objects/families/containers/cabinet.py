"""A small cabinet with one drawer, as two bodies."""

from dataclasses import asdict
from itertools import product
from typing import Self

import numpy as np

from pipeline.poses import Pose
from pipeline.world.looks.materials import WOODS, metal, painted, wood
from pipeline.world.shapes import Material, Shape

from ...colliders import box_collider, capsule_between, tray
from ...contract import NamedFrames, Slide, register
from ...geometry import at, box, sweep
from ...grasping import handle_pinches
from ...kit import COLOURS, LARGE, Parametric, between, hollow, mark, one_of, standing, texture

BOARD = 0.012
GAP = 0.002
TONES = (*WOODS, *COLOURS)


def _skin(colour: str, texture: int) -> Material:
    return wood(colour, texture) if colour in WOODS else painted(colour)


@register("drawer")
class Drawer(Parametric):
    """An open box with a front board and an upright bar handle towards -y; origin under the middle
    of the box."""

    hx: float  # of the box
    hy: float
    height: float
    front_hx: float
    front_height: float
    bar: float  # half length of the handle, upright
    colour: str
    handle_colour: str
    seed: int

    @classmethod
    def draw(  # pyright: ignore[reportIncompatibleMethodOverride]
        cls, rng: np.random.Generator
    ) -> Self:
        return cls(**asdict(Cabinet.draw(rng).drawer()))

    @property
    def handle_at(self) -> tuple[float, float, float]:
        """Middle of the handle bar, 4 cm before the front: room for fingertips on either side."""
        return (0.0, -self.hy - BOARD - 0.040, self.front_height / 2)

    def shape(self) -> Shape:
        _, y, z = self.handle_at
        hx, hy, h = self.hx, self.hy, self.height
        board = (self.front_hx, BOARD / 2, self.front_height / 2)
        place = (0, -self.hy - BOARD / 2, self.front_height / 2)
        side = box(0.003, hy, h / 2)
        walls = [
            at(box(hx, hy, 0.003), (0, 0, 0.003)),
            *(at(side, (x, 0, h / 2)) for x in (hx - 0.003, 0.003 - hx)),
            at(box(hx, 0.003, h / 2), (0, hy - 0.003, h / 2)),
        ]
        ends = [np.array([0, y, z + side * self.bar]) for side in (-1, 1)]
        root = np.array([0, -self.hy - BOARD - y, 0])
        bar = sweep([ends[0] + root, ends[0], ends[1], ends[1] + root], 0.006, 8)
        return Shape(
            (
                (at(box(*board, 0.002), place), _skin(self.colour, self.seed)),
                *((w, painted("beige")) for w in walls),
                (bar, metal(self.handle_colour)),
            ),
            (
                *tray(hx, hy, 0.006, h),
                *box_collider(*board, place),
                *capsule_between(ends[0], ends[1], 0.006),
                *(c for e in ends for c in capsule_between(e, e + root, 0.006)),
            ),
            mass=0.6,
            friction=0.8,
        )

    def frames(self) -> NamedFrames:
        _, y, z = self.handle_at
        grips, leans = [], (0, -15, -30, -45, -60)
        for dz, turn in product((-0.01, 0.005, 0.02), (0.0, 0.2, -0.2)):
            out = (np.sin(turn), -np.cos(turn), 0)
            grips += handle_pinches((0, y, z + dz), (0, 0, 1), out, 0.012, leans)
        handle = mark(*self.handle_at, normal=(0, -1, 0))
        return hollow(self.front_height, 0.006, grips, handle=handle)

    def facts(self) -> dict[str, str]:
        return super().facts() | {"handle": self.handle_colour}


@register("cabinet")
class Cabinet(Parametric):
    """The shell; the drawer's bay is open towards -y, below it a closed front."""

    colour: str = one_of(TONES)
    hx: float = between(0.14, 0.17, size=LARGE)  # half extent along x
    hy: float = between(0.1, 0.12)
    bay: float = between(0.09, 0.11)  # height of the opening
    foot: float = between(0.03, 0.08)  # height of the closed part below
    bar: float = between(0.03, 0.036)
    drawer_colour: str = one_of(TONES, also="colour")
    handle_colour: str = one_of(("silver", "gold", "charcoal"))
    seed: int = texture()

    @property
    def height(self) -> float:
        return self.foot + self.bay + 2 * BOARD

    def drawer(self) -> Drawer:
        hx, hy, height = self.hx - BOARD - GAP, self.hy - BOARD - GAP, self.bay - 2 * GAP
        looks = self.drawer_colour, self.handle_colour, self.seed + 1
        return Drawer(hx, hy, 0.6 * self.bay, hx, height, self.bar, *looks)

    def slot(self) -> Pose:
        """Pose (7,) of the closed drawer's origin in the cabinet's frame."""
        return mark(0, 0, self.foot + BOARD + GAP)

    def slide(self) -> Slide:
        return Slide((0.0, -1.0, 0.0), 0.0, 1.4 * self.hy)

    def boards(self) -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
        hx, hy, h, f, t = self.hx, self.hy, self.height, self.foot, BOARD / 2
        return [
            *(((t, hy, h / 2), (x, 0, h / 2)) for x in (hx - t, t - hx)),
            ((hx - BOARD, t, h / 2), (0, hy - t, h / 2)),
            *(((hx - BOARD, hy, t), (0, 0, z)) for z in (h - t, f + t)),
            ((hx - BOARD, t, f / 2), (0, t - hy, f / 2)),
        ]

    def shape(self) -> Shape:
        skin, boards = _skin(self.colour, self.seed), self.boards()
        return Shape(
            tuple((at(box(*half, 0.0012), centre), skin) for half, centre in boards),
            tuple(c for half, centre in boards for c in box_collider(*half, centre)),
            mass=3.0,
        )

    def frames(self) -> NamedFrames:
        return standing(self.height, slot=self.slot())

    def facts(self) -> dict[str, str]:
        wooden = self.colour in WOODS
        return super().facts() | {
            "material": "wooden" if wooden else "painted",
            "plain": "" if wooden else "painted",
            "drawer": self.drawer_colour,
            "handle": self.handle_colour,
        }

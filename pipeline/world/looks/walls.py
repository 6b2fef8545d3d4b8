"""Walls of four rooms as flat drawings. A tile is 3 m of wall, row 0 at the floor; lengths are
metres from its left and the floor."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from pipeline.poses import Floats32

from .textures import BASIC, Rgba, by_name, fractal, rgba

SPAN = 3.0  # m
type Span = tuple[float, float]
MUTED = (
    *((0.66, 0.27, 0.22), (0.24, 0.38, 0.52), (0.83, 0.71, 0.42), (0.35, 0.47, 0.38)),
    *((0.87, 0.85, 0.80), (0.22, 0.24, 0.27), (0.56, 0.44, 0.34), (0.46, 0.50, 0.55)),
)
OAK, STEEL, GLASS = (0.68, 0.53, 0.38), (0.62, 0.63, 0.65), (0.86, 0.92, 0.97)


@dataclass(eq=False)
class Wall:
    """A drawing on `canvas` (N,N,3), sRGB 0-1, whose row 0 is the floor."""

    canvas: Floats32
    rng: Generator

    def block(
        self, x: float, low: float, width: float, height: float, colour: ArrayLike, relief=0.12
    ) -> None:
        """A rectangle, lighter at its top and darker at its foot by `relief`."""
        area = self._area(x, low, width, height)
        ramp = np.linspace(1 - relief, 1 + relief / 2, len(area), dtype=np.float32)
        area[:] = np.clip(np.asarray(colour, np.float32) * ramp[:, None, None], 0, 1)

    def shadow(self, x: float, low: float, width: float, height: float, share=0.25) -> None:
        """A soft shadow that fades from top to foot."""
        area = self._area(x, low, width, height)
        area *= 1 - np.linspace(0, share, len(area), dtype=np.float32)[:, None, None]

    def shelf(self, left: float, low: float, width: float, sizes: Span, heights: Span) -> None:
        self.shadow(left, low - 0.16, width, 0.16)
        self.block(left, low - 0.03, width, 0.03, OAK)
        self.row(left, low, width, sizes, heights)

    def row(self, left: float, low: float, width: float, sizes: Span, heights: Span) -> None:
        """Boxes, books or jars of random sizes and muted colours; a third has a label."""
        at = left + 0.03
        while at < left + width - sizes[1]:
            w, h = self.rng.uniform(*sizes), self.rng.uniform(*heights)
            colour = np.array(MUTED[self.rng.integers(len(MUTED))]) * self.rng.uniform(0.85, 1.1)
            self.shadow(at - 0.012, low, w + 0.03, h, 0.3)
            self.block(at, low, w, h, colour, 0.2)
            self.block(at + 0.9 * w, low, 0.1 * w, h, colour * 0.78, 0.2)
            if self.rng.random() < 0.35:
                label = at + 0.15 * w, low + 0.35 * h, 0.6 * w, 0.3 * h
                self.block(*label, (0.90, 0.89, 0.85), 0.03)
            at += w + self.rng.choice([0.006, 0.01, 0.05, 0.12])

    def cupboards(self, height: float, width: float, colour: ArrayLike, drawers: int) -> None:
        """A row from the floor to `height`, with drawers, under a worktop."""
        each = (height - 0.1) / drawers
        self.block(0, 0, SPAN, 0.1, (0.20, 0.20, 0.21))
        for k in range(round(SPAN / width)):
            for j in range(drawers):
                low = 0.1 + j * each
                self.block(k * width + 0.004, low, width - 0.008, each - 0.008, colour, 0.08)
                x, y, wide = k * width + 0.35 * width, low + 0.72 * each, 0.3 * width
                self.block(x, y, wide, 0.012, STEEL, 0.3)
                self.shadow(x, y - 0.015, wide, 0.015)
        self.shadow(0, height - 0.06, SPAN, 0.06, 0.35)
        self.block(0, height, SPAN, 0.04, OAK, 0.1)

    def window(self, left: float, low: float, width: float, height: float) -> None:
        self.block(left - 0.05, low - 0.05, width + 0.1, height + 0.1, (0.93, 0.93, 0.92), 0.05)
        for k in range(2):
            self.block(left + k * (width / 2 + 0.015), low, width / 2 - 0.03, height, GLASS, 0.10)
        self.block(left - 0.08, low - 0.09, width + 0.16, 0.04, (0.88, 0.88, 0.86))
        self.shadow(left - 0.08, low - 0.16, width + 0.16, 0.07)

    def _area(self, left: float, low: float, width: float, height: float) -> Floats32:
        sides = np.clip((left, left + width, low, low + height), 0, SPAN).tolist()
        x0, x1, y0, y1 = (round(v * len(self.canvas) / SPAN) for v in sides)
        return self.canvas[y0:y1, x0:x1]


def _plaster(rng: Generator, size: int, colour: ArrayLike) -> Wall:
    stipple = fractal(rng, size, (6, 6), 5)
    fall = np.linspace(0.90, 1.02, size, dtype=np.float32)[:, None]  # the floor takes light away
    tone = (fall * (0.975 + 0.05 * stipple))[..., None]
    return Wall((np.asarray(colour, np.float32) * tone).astype(np.float32), rng)


def _out_of_focus(canvas: Floats32, blur: float = 2.0) -> Rgba:
    """The wall out of focus, with light pooling."""
    rng = np.random.Generator(np.random.Philox(len(canvas)))
    wide = np.pad(canvas, ((8, 8), (8, 8), (0, 0)), mode="wrap")
    soft = np.asarray(cv2.GaussianBlur(wide, (0, 0), blur))[8:-8, 8:-8]
    return rgba(soft * (0.90 + 0.18 * fractal(rng, len(canvas), (2, 3), 2))[..., None])


def distant(pattern: str) -> Callable[[Generator, int, ArrayLike], Rgba]:
    """A pattern of `textures`, seen behind the table."""
    return lambda rng, size, colour: _out_of_focus(
        np.asarray(BASIC[pattern](rng, size, colour)[..., :3] / 255, np.float32), 1.0
    )


def workshop(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    wall = _plaster(rng, size, colour)
    wall.cupboards(0.62, 0.5, MUTED[rng.integers(len(MUTED))], 3)
    wall.row(0.1, 0.66, 2.8, (0.10, 0.30), (0.06, 0.14))
    left = 0.15 + 1.2 * rng.random()
    board = (left, 0.85, 1.35, 0.75)
    wall.shadow(left + 0.01, 0.78, 1.36, 0.07)
    wall.block(*board, np.array((0.80, 0.74, 0.63)) * rng.uniform(0.8, 1.05), 0.05)
    n = size / SPAN
    for x in np.arange(left + 0.05, left + 1.33, 0.05):
        for y in np.arange(0.9, 1.58, 0.05):
            wall.canvas[int(y * n), int(x * n)] *= 0.6
    for k in range(7):
        x, h = left + 0.1 + 0.18 * k, rng.uniform(0.14, 0.3)
        tool, w = np.array(MUTED[rng.integers(len(MUTED))]), rng.uniform(0.02, 0.04)
        wall.shadow(x + 0.015, 1.5 - h, w, h, 0.3)
        wall.block(x, 1.5 - h, w, 0.55 * h, tool, 0.25)
        wall.block(x + 0.3 * w, 1.5 - 0.45 * h, 0.4 * w, 0.45 * h, STEEL, 0.2)
        if k % 2:
            wall.block(x - 0.02, 1.46, w + 0.04, 0.035, STEEL, 0.3)
    wall.shelf(left - 0.1, 1.78, 1.5, (0.09, 0.22), (0.10, 0.24))
    wall.window((left + 1.65) % 2.2, 1.2, 0.7, 0.9)
    return _out_of_focus(wall.canvas)


def kitchen(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    wall = _plaster(rng, size, colour)
    width, height = (0.15, 0.075) if rng.random() < 0.5 else (0.1, 0.1)
    for j in range(int(1.5 / height)):
        for i in range(-1, int(SPAN / width) + 1):
            tone = np.asarray(colour) * rng.uniform(0.97, 1.04) * 1.03
            x = (i + 0.5 * (j % 2) * (width > height)) * width
            wall.block(x, j * height, width - 0.006, height - 0.006, tone, 0.04)
    left = 0.2 + rng.random()
    wall.shelf(left, 1.02, 1.5, (0.06, 0.11), (0.09, 0.18))
    cupboard = np.array(MUTED[rng.integers(2, 5)])
    wall.cupboards(0.56, 0.6, cupboard, 1)
    wall.row(0.2, 0.60, 2.6, (0.07, 0.16), (0.10, 0.26))
    for k in range(6):
        wall.block(0.5 * k + 0.01, 1.75, 0.48, 0.85, cupboard, 0.06)
        wall.block(0.5 * k + 0.42, 1.85, 0.015, 0.12, STEEL)
    wall.shadow(0, 1.6, SPAN, 0.15, 0.3)
    return _out_of_focus(wall.canvas)


def laboratory(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    wall = _plaster(rng, size, colour)
    wall.shadow(0, 0.80, SPAN, 0.06)
    wall.block(0, 0.86, SPAN, 0.12, (0.88, 0.88, 0.87), 0.12)
    for x in np.arange(0.1, SPAN, 0.28):
        wall.block(float(x), 0.89, 0.06, 0.06, (0.80, 0.80, 0.79), 0.05)
        wall.block(float(x) + 0.018, 0.912, 0.022, 0.016, (0.3, 0.3, 0.31), 0.0)
    wall.cupboards(0.58, 0.5, MUTED[rng.choice([4, 7])], 2)
    wall.row(0.1, 0.62, 2.8, (0.08, 0.34), (0.08, 0.20))
    left = 0.1 + 0.6 * rng.random()
    wall.shadow(left, 1.06, 1.3, 0.05)
    wall.block(left - 0.02, 1.10, 1.34, 0.84, STEEL, 0.05)
    wall.block(left, 1.12, 1.30, 0.80, (0.94, 0.95, 0.95), 0.03)
    for y in np.arange(1.25, 1.85, 0.1):
        wall.block(left + 0.1, float(y), rng.uniform(0.2, 0.9), 0.008, (0.24, 0.32, 0.52), 0.0)
    for k, low in enumerate((1.12, 1.5)):
        wall.shelf(left + 1.5, low, 1.2, (0.10, 0.32), (0.12, 0.25 + 0.04 * k))
    return _out_of_focus(wall.canvas)


def office(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    wall = _plaster(rng, size, colour)
    left = 1.3 * rng.random()
    for low in (1.0, 1.4):
        wall.shelf(left, low, 1.5, (0.02, 0.055), (0.18, 0.28))
    wall.window(left + 1.75 if left < 0.4 else max(left - 0.9, 0.1), 1.1, 0.7, 1.1)
    wall.cupboards(0.54, 0.75, MUTED[rng.choice([4, 5, 6])], 2)
    wall.row(0.1, 0.58, 2.8, (0.02, 0.06), (0.16, 0.28))
    return _out_of_focus(wall.canvas)


WALLS: dict[str, Callable[[Generator, int, ArrayLike], Rgba]] = by_name(
    workshop, kitchen, laboratory, office
)

DISTANT = {
    f"distant {name}": distant(name)
    for name in ("paint", "bricks", "tiles", "planks", "marble", "stripes", "plain")
}

"""Seeded, tileable textures: (size, size, 4) uint8 sRGB. Each draws from its Generator alone;
colours are sRGB 0-1."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from pipeline.poses import Floats, Pixels

Rgba = Pixels
Field = NDArray[np.floating]


def by_name[**P, R](*functions: Callable[P, R]) -> dict[str, Callable[P, R]]:
    return {each.__name__.strip("_").replace("_", " "): each for each in functions}


def value_noise(rng: Generator, size: int, cells: tuple[int, int]) -> Field:
    """Tileable cubic noise (size, size) 0-1 on a random lattice of `cells` (rows, columns)."""
    rows, columns = cells
    lattice = np.pad(rng.random((rows, columns), dtype=np.float32), 2, mode="wrap")
    texel = np.arange(size, dtype=np.float32) + 0.5
    x, y = np.meshgrid(texel * (columns / size) + 1.5, texel * (rows / size) + 1.5)
    field = cv2.remap(lattice, x, y, cv2.INTER_CUBIC)
    return np.clip(field, 0.0, 1.0).astype(np.float32)


def fine_noise(rng: Generator, size: int, texels: int) -> Field:
    """Value noise (size, size) 0-1 whose cells are `texels` wide."""
    return value_noise(rng, size, (size // texels, size // texels))


def chequered(k: NDArray[Any]) -> NDArray[Any]:
    """The parity (N, N) of the sums of whole numbers (N,)."""
    return (k[:, None] + k[None]) % 2


def border(at: NDArray[np.floating]) -> Field:
    """The distance (N, N) of texels at shares `at` (N,) of a side from the nearest edge."""
    edge = np.minimum(at, 1 - at)
    return np.minimum(edge[:, None], edge[None])


def fractal(rng: Generator, size: int, cells: tuple[int, int], octaves: int = 4) -> Field:
    """Sum of `octaves` of value noise, each twice as fine and half as strong, scaled to 0-1."""
    total = np.zeros((size, size), np.float32)
    for k in range(octaves):
        rows, columns = (min(count << k, size) for count in cells)
        total += 0.5**k * value_noise(rng, size, (rows, columns))
    low, high = float(total.min()), float(total.max())
    return (total - low) / max(high - low, 1e-6)


def mix(a: ArrayLike, b: ArrayLike, t: Field) -> Field:
    """Colour ramp (size, size, 3) from `a` to `b` by `t` (size, size) in 0-1."""
    a, b = np.asarray(a, np.float32), np.asarray(b, np.float32)
    return a + (b - a) * t[..., None]


def rgba(colour: Field) -> Rgba:
    """Opaque uint8 image of float colours (H, W, 3) in 0-1."""
    out = np.full((*colour.shape[:2], 4), 255, np.uint8)
    out[..., :3] = np.clip(np.rint(colour * 255.0), 0, 255)
    return out


def shade(colour: ArrayLike, factor: float) -> Floats:
    return np.clip(np.asarray(colour, float) * factor, 0.0, 1.0)


def wood(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    v = np.linspace(0, 1, size, endpoint=False, dtype=np.float32)[:, None]
    warp = fractal(rng, size, (3, 1), 3)
    rings = np.float32(rng.integers(5, 10))
    grain = 0.5 + 0.5 * np.sin(2 * np.pi * (rings * v + 2.2 * warp))
    fibre = value_noise(rng, size, (size // 2, 4)) * 0.6 + value_noise(rng, size, (size, 10)) * 0.4
    t = np.clip(0.55 * grain**2 + 0.45 * fibre, 0, 1)
    return rgba(mix(shade(colour, 1.1), shade(colour, 0.72), t))


def planks(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    board = wood(rng, size, colour)[..., :3].astype(np.float32) / 255
    n, width = 4, size // 4
    out = np.empty_like(board)
    for i in range(n):
        tone, strip = np.float32(rng.uniform(0.84, 1.1)), slice(i * width, (i + 1) * width)
        out[strip] = np.roll(board[strip], int(rng.integers(size)), axis=1) * tone
        out[i * width] *= 0.55
        out[strip, int(rng.integers(size))] *= 0.6
    return rgba(out)


def marble(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    body = fractal(rng, size, (3, 3), 4)
    vein = 1 - np.abs(2 * fractal(rng, size, (2, 3), 5) - 1)
    t = np.clip(vein**14 * 0.8 + 0.22 * body, 0, 1)
    return rgba(mix(shade(colour, 1.08), shade(colour, 0.5), t))


def stone(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    clouds = fractal(rng, size, (4, 4), 4)
    t = 0.5 * clouds + 0.5 * fine_noise(rng, size, 2)
    return rgba(mix(shade(colour, 1.12), shade(colour, 0.62), t))


def weave(u: Field, ridge: Field) -> Field:
    """Height (N, N) of a plain weave of threads with a profile `ridge` (N,), at threads `u`."""
    over = chequered(np.floor(u)).astype(np.float32)
    return over * ridge[:, None] + (1 - over) * ridge[None]


def fabric(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    threads = int(rng.choice([16, 24, 32]))
    u = np.arange(size, dtype=np.float32) * (threads / size)
    ridge = np.sin(np.pi * (u % 1)) ** 0.7
    height = weave(u, ridge)
    yarn = 0.5 * value_noise(rng, size, (threads, 4)) + 0.5 * value_noise(rng, size, (4, threads))
    t = np.clip(1 - 0.7 * height + 0.35 * (yarn - 0.5), 0, 1)
    return rgba(mix(shade(colour, 1.1), shade(colour, 0.6), t))


def terrazzo(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    """Chips of four tones; they wrap around the border."""
    canvas = np.tile(np.asarray(colour, np.float32), (size, size, 1))
    own = np.asarray(colour, np.float32)
    tones = own * rng.uniform(0.45, 1.25, (4, 1)) + rng.uniform(-0.12, 0.12, (4, 3))
    for _ in range(90):
        centre, radius = rng.integers(0, size, 2), rng.uniform(0.008, 0.03) * size
        chip = draw_chip(rng, radius, 6, 1.3)
        tone = np.clip(tones[rng.integers(4)], 0, 1).tolist()
        for shift in ((0, 0), (size, 0), (0, size), (size, size)):
            points = np.rint(chip + centre - np.array(shift)).astype(np.int32)
            cv2.fillPoly(canvas, [points], tone, lineType=cv2.LINE_AA)
    return rgba(canvas)


def draw_chip(rng: Generator, radius: float, corners: int, longest: float) -> Field:
    """Corners (K,2) of a stone chip, 0.6 to `longest` of `radius` from its middle."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
    rays = np.stack([np.cos(angles), np.sin(angles)], 1)
    return rays * radius * rng.uniform(0.6, longest, (corners, 1))


def bricks(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    return _courses(rng, size, colour, 8, 0.06, (0.78, 0.76, 0.72))


def tiles(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    return _courses(rng, size, colour, 4, 0.03, (0.86, 0.86, 0.84))


def _courses(
    rng: Generator, size: int, colour: ArrayLike, rows: int, gap: float, joint: ArrayLike
) -> Rgba:
    """Four stones wide; if they are wider than tall, every other row is shifted by half a stone."""
    columns, offset = 4, 0.5 * (rows > 4)
    v = np.arange(size, dtype=np.float32)[:, None] * (rows / size)
    row = np.floor(v).astype(int)
    u = np.arange(size, dtype=np.float32)[None] * (columns / size) + offset * (row % 2)
    column = np.floor(u).astype(int) % columns
    tone = (1 + rng.uniform(-0.14, 0.1, (rows, columns)))[row, column].astype(np.float32)
    grain = 1 + 0.12 * (fine_noise(rng, size, 4) - 0.5)
    edge_v = np.minimum(v % 1, 1 - v % 1) / columns * rows
    edge_u = np.minimum(u % 1, 1 - u % 1)
    edge = np.minimum(edge_u, edge_v * columns / rows * columns / rows)
    inside = np.clip((edge - gap) * size / columns / 2 + 0.5, 0, 1)
    body = np.asarray(colour, np.float32) * (tone * grain)[..., None]
    mortar = (1 - inside)[..., None] * np.asarray(joint, np.float32)
    return rgba(mix(np.zeros(3), np.ones(3), inside) * body + mortar)


def paint(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    t = 0.6 * fractal(rng, size, (3, 3), 3) + 0.4 * fine_noise(rng, size, 3)
    return rgba(mix(shade(colour, 1.05), shade(colour, 0.92), t))


def checker(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    n = int(rng.choice([4, 6, 8]))
    k = np.arange(size) * n // size
    t = chequered(k).astype(np.float32)
    own = np.asarray(colour, float)
    other = shade(own, rng.uniform(0.35, 0.7)) if own.mean() > 0.35 else 1 - 0.4 * own
    return rgba(mix(colour, other, t))


def brushed(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    t = 0.7 * value_noise(rng, size, (size, 3)) + 0.3 * value_noise(rng, size, (size, 12))
    return rgba(mix(shade(colour, 1.1), shade(colour, 0.78), t))


def stripes(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    n = int(rng.choice([4, 6, 8, 10]))
    u = (np.arange(size, dtype=np.float32) * (n / size)) % 1
    t = np.where(u < 0.5, 0.0, np.where(u < 0.9, 1.0, 0.4)).astype(np.float32)
    return rgba(mix(colour, rng.uniform(0.1, 0.95, 3), np.tile(t, (size, 1))))


def noise(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    return rgba(mix(colour, rng.uniform(0, 1, 3), fractal(rng, size, (4, 4), 5)))


def plain(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    return rgba(mix(shade(colour, 1.02), shade(colour, 0.98), fine_noise(rng, size, 2)))


BASIC: dict[str, Callable[[Generator, int, ArrayLike], Rgba]] = by_name(
    wood,
    planks,
    marble,
    stone,
    fabric,
    terrazzo,
    bricks,
    tiles,
    paint,
    checker,
    brushed,
    stripes,
    noise,
    plain,
)

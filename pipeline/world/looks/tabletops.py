"""Table tops and floors (size,size,4), seeded as `textures`. A tile is 0.5 to 0.8 m, 512 texels a
side."""

from collections.abc import Callable
from itertools import product

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from .textures import (
    Field,
    Rgba,
    by_name,
    draw_chip,
    fine_noise,
    fractal,
    mix,
    rgba,
    shade,
    value_noise,
    weave,
)


def grain(rng: Generator, size: int) -> Field:
    """Wood along x in 0-1 (size, size), 1 is dark."""
    v = np.linspace(0, 1, size, endpoint=False, dtype=np.float32)[:, None]
    count = np.float32(rng.integers(18, 30))
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (count * v + 1.6 * fractal(rng, size, (4, 1), 2)))
    fibre = value_noise(rng, size, (size // 2, 5))
    pores = np.clip(value_noise(rng, size, (size, 24)) - 0.72, 0, 1) * 2.2
    return np.clip(0.30 * rings + 0.42 * fibre + pores, 0, 1).astype(np.float32)


def staves(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    rows, field = 8, grain(rng, size)
    width = size // rows
    board = np.empty((size, size, 3), np.float32)
    for i in range(rows):
        strip = slice(i * width, (i + 1) * width)
        t = np.roll(field[strip], int(rng.integers(size)), axis=1)
        board[strip] = _wood(colour, t) * np.float32(rng.uniform(0.92, 1.05))
        board[i * width] *= 0.86
        board[strip, int(rng.integers(size))] *= 0.88
    return rgba(board)


def veneer(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    slow = value_noise(rng, size, (4, 2))[..., None]
    return rgba(_wood(colour, grain(rng, size)) * (0.95 + 0.08 * slow))


def _wood(colour: ArrayLike, t: Field) -> Field:
    dark = shade(colour, 0.74) * np.array([1.0, 0.96, 0.9])
    return mix(shade(colour, 1.05), dark, t)


def laminate(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    specks = fine_noise(rng, size, 1)
    t = 0.25 * np.clip((specks - 0.80) * 5, 0, 1) - 0.14 * np.clip((0.2 - specks) * 5, 0, 1)
    cloud = 0.03 * (fractal(rng, size, (3, 3), 3) - 0.5)
    return rgba(np.asarray(colour, np.float32) * (1 - t - cloud)[..., None])


def steel(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    streaks = 0.6 * value_noise(rng, size, (size, 4))
    streaks = streaks + 0.4 * value_noise(rng, size, (size // 2, 12))
    sheet = np.ascontiguousarray(mix(shade(colour, 1.04), shade(colour, 0.90), streaks), np.float32)
    tone = shade(colour, 1.1).tolist()
    for x, y, length, slope in rng.random((14, 4)):
        x, y = int(x * size), int(y * size)
        end = (x + int(60 * length), y + int(24 * (slope - 0.5)))
        cv2.line(sheet, (x, y), end, tone, 1, cv2.LINE_AA)
    return rgba(sheet)


def linen(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    threads = size // 4
    u = np.arange(size, dtype=np.float32) / 4
    height = weave(u, np.sin(np.pi * (u % 1)))
    yarn = value_noise(rng, size, (threads, 6)) + value_noise(rng, size, (6, threads)) - 1
    cloth = 0.90 + 0.12 * height + 0.09 * yarn + _folds(rng, size)
    return rgba(np.asarray(colour, np.float32) * cloth[..., None])


def _folds(rng: Generator, size: int) -> Field:
    """Shading, about -0.2 to 0.1, of folds and creases."""
    across = np.linspace(0, 1, size, endpoint=False, dtype=np.float32)
    bend, slow = fractal(rng, size, (2, 2), 3) - 0.5, fractal(rng, size, (3, 2), 3) - 0.5
    waves = np.sin(2 * np.pi * (across[None] + 2 * across[:, None] + 1.3 * bend)) * (0.6 + slow)
    kept = np.exp(-(((across - 0.5 + 0.004 * np.sin(9 * across)) * 90) ** 2))
    creases = 0.10 * (kept[None] + 0.7 * kept[:, None])
    return (0.09 * waves + 0.12 * slow - creases).astype(np.float32)


def gingham(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    own = np.asarray(colour, np.float32)
    bands = (np.arange(size) * int(rng.choice([16, 24, 32])) // size % 2).astype(np.float32)
    k = np.arange(size)
    thread = 0.94 + 0.10 * ((k[:, None] + k[None]) // 2 % 2) * fine_noise(rng, size, 2)
    t = np.asarray(cv2.GaussianBlur((bands[:, None] + bands[None]) / 2, (3, 3), 0.8), np.float32)
    return rgba(mix(own * 0.45 + 0.5, own * 0.8, t) * (thread + _folds(rng, size))[..., None])


def felt(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    along, across = (value_noise(rng, size, c) for c in ((size // 6, size), (size, size // 6)))
    fibres, pills = along + across - 1, np.clip(fine_noise(rng, size, 4) - 0.8, 0, 1)
    tone = 0.86 + 0.22 * fibres + 0.16 * fractal(rng, size, (4, 4), 4) + 0.5 * pills
    return rgba(np.asarray(colour, np.float32) * tone[..., None].astype(np.float32))


def fine_terrazzo(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    """Stone chips of 1 to 8 mm under a worn polish."""
    own = np.asarray(colour, np.float32)
    tone = 0.94 + 0.08 * fractal(rng, size, (6, 6), 4) + 0.05 * fine_noise(rng, size, 1)
    canvas = np.ascontiguousarray(own * tone[..., None], np.float32)
    tones = np.clip(own * rng.uniform(0.62, 1.12, (7, 1)) + rng.uniform(-0.05, 0.05, (7, 3)), 0, 1)
    for _ in range(1100):
        centre, radius = rng.integers(0, size, 2), (0.001 + 0.006 * rng.random() ** 3) * size
        chip = draw_chip(rng, radius, 7, 1.2)
        tone = tones[rng.integers(7)].tolist()
        wraps = (np.minimum(centre, size - centre) < 0.02 * size).any()
        for shift in product((0, size), repeat=2) if wraps else [(0, 0)]:
            points = np.rint(chip + centre - np.array(shift)).astype(np.int32)
            cv2.fillPoly(canvas, [points], tone, lineType=cv2.LINE_AA)
    polish = (0.97 + 0.05 * fine_noise(rng, size, 1))[..., None]
    return rgba(cv2.GaussianBlur(canvas, (3, 3), 0.7) * polish)


def granite(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    own = np.asarray(colour, np.float32)
    crystals, fine = fine_noise(rng, size, 3), fine_noise(rng, size, 1)
    t = 0.7 * crystals + 0.3 * fine + 0.25 * (fractal(rng, size, (4, 4), 3) - 0.5)
    light, dark = np.clip((t - 0.58) * 6, 0, 1), np.clip((0.40 - t) * 6, 0, 1)
    return rgba(own * (1 + 0.10 * light - 0.30 * dark)[..., None])


def concrete(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    clouds, sand = fractal(rng, size, (3, 3), 4), fine_noise(rng, size, 1)
    slab = np.asarray(colour, np.float32) * (0.90 + 0.13 * clouds + 0.05 * (sand - 0.5))[..., None]
    slab = np.ascontiguousarray(slab, np.float32)
    tone = shade(colour, 0.62).tolist()
    for x, y in rng.integers(0, size, (40, 2)).tolist():
        cv2.circle(slab, (x, y), 1, tone, -1, cv2.LINE_AA)
    return rgba(slab)


def cutting_mat(rng: Generator, size: int, colour: ArrayLike) -> Rgba:
    wear = fractal(rng, size, (4, 4), 4)
    mat = np.asarray(colour, np.float32) * (0.90 + 0.16 * wear)[..., None]
    line = np.asarray(colour, np.float32) * 0.5 + 0.5
    cell = size // 32
    for k in range(32):
        share = 0.55 if k % 5 == 0 and k < 30 else 0.22
        for cut in (mat[k * cell], mat[:, k * cell]):
            cut += share * (line - cut)
    return rgba(mat)


TABLETOPS: dict[str, Callable[[Generator, int, ArrayLike], Rgba]] = by_name(
    staves,
    veneer,
    laminate,
    steel,
    linen,
    granite,
    concrete,
    cutting_mat,
    gingham,
    felt,
    fine_terrazzo,
)

"""Skins of things in use, (size, size, 3) float sRGB 0-1, drawn from their Generator alone;
packaging."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from pipeline.poses import Floats32

from .textures import (
    Field,
    Rgba,
    border,
    by_name,
    chequered,
    fine_noise,
    fractal,
    mix,
    rgba,
    value_noise,
)

STRANDS = 8  # of a tile of wicker, both ways
Colour = Floats32


def toned(colour: Colour, tone: Field) -> Field:
    """The image (N,N,3) of a colour (3,) times a tone (N,N)."""
    return colour * tone[..., None].astype(np.float32)


def wicker(rng: Generator, size: int, colour: Colour) -> Field:
    u = (np.arange(size, dtype=np.float32) + 0.5) * (STRANDS / size)
    k, within = np.floor(u).astype(int), u % 1
    tones = rng.uniform(0.80, 1.12, (2, STRANDS)).astype(np.float32)
    grids = (size // 2, STRANDS), (STRANDS, size // 2)
    fibres = [0.85 + 0.25 * value_noise(rng, size, grid) for grid in grids]
    round_ = np.sqrt(np.clip(1 - ((within - 0.5) / 0.52) ** 2, 0, 1)).astype(np.float32)
    # where a strand dives below the next
    bent = (0.62 + 0.38 * np.sin(np.pi * within)).astype(np.float32)
    level = tones[0][k][:, None] * round_[:, None] * bent[None] * fibres[0]
    upright = tones[1][k][None] * round_[None] * bent[:, None] * fibres[1]
    return toned(colour, 0.30 + 0.78 * np.where(chequered(k) == 0, level, upright))


def cord(rng: Generator, size: int, colour: Colour) -> Field:
    u = (np.arange(size, dtype=np.float32) + 0.5) / size
    turn = u[:, None] * 4 + u[None]
    tones = rng.uniform(0.86, 1.08, 4).astype(np.float32)[np.floor(turn).astype(int) % 4]
    fibres = value_noise(rng, size, (size // 8, size // 2))
    lit = np.sqrt(np.clip(1 - ((turn % 1 - 0.5) / 0.53) ** 2, 0, 1))
    return toned(colour, (0.45 + 0.60 * lit) * tones * (0.92 + 0.14 * fibres))


def crust(rng: Generator, size: int, colour: Colour) -> Field:
    blotches, fine = fractal(rng, size, (3, 3), 4), fractal(rng, size, (20, 20), 3)
    dark = colour * np.array([0.62, 0.52, 0.44], np.float32)
    skin = mix(np.minimum(colour * 1.14 + 0.02, 1), dark, blotches)
    ridge = 1 - np.abs(2 * fractal(rng, size, (5, 5), 4) - 1)
    skin = skin * (1 - 0.40 * np.clip((ridge - 0.94) * 16, 0, 1) - 0.34 * (fine - 0.5))[..., None]
    flour = np.clip((fractal(rng, size, (5, 5), 4) - 0.66) * 3, 0, 0.6)
    flour = flour * fine_noise(rng, size, 2)
    return skin + (np.array([0.90, 0.85, 0.76], np.float32) - skin) * flour[..., None]


def turned(rng: Generator, size: int, colour: Colour) -> Field:
    v = np.linspace(0, 1, size, dtype=np.float32)[:, None]
    rings = value_noise(rng, size, (size // 2, 2)) * 0.14 + value_noise(rng, size, (9, 1)) * 0.10
    grooves = sum(np.exp(-(((v - at) * 70) ** 2)) for at in (0.06, 0.17, 0.24))
    return toned(colour, 0.84 + rings - 0.34 * grooves)


def shell(rng: Generator, size: int, colour: Colour) -> Field:
    """A mouse from above, buttons at v = 1: seams, ribbed grips, a mark."""
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at * 2 - 1, at)
    seam = np.exp(-((u * size / 3) ** 2)) * (v > 0.55)
    seam += np.exp(-(((v - 0.55 + 0.10 * u * u) * size / 2.2) ** 2))
    edge = np.abs(u) - 0.70 - 0.12 * np.cos(3 * (v - 0.4))
    grip = np.clip(0.5 - edge * -size / 2, 0, 1) * (v < 0.85)
    ribs = 0.72 + 0.14 * np.sin(v * 2 * np.pi * 22)
    mark = (np.abs(np.hypot(u * 1.1, (v - 0.22) * 3) - 0.16) < 0.035) & (np.abs(u) > 0.03)
    tone = (0.97 + 0.06 * fractal(rng, size, (4, 4), 4)) * (1 - grip) + ribs * grip
    tone = tone * (1 - 0.65 * np.clip(seam + 0.7 * np.exp(-((edge * size / 3) ** 2)), 0, 1))
    skin = toned(colour, tone)
    skin[mark] = skin[mark] * 0.5 + 0.5 * (0.15 if float(colour.mean()) > 0.5 else 0.85)
    return skin


def runner(rng: Generator, size: int, colour: Colour) -> Field:
    at = (np.arange(size, dtype=np.float32) + 0.5) / size
    ribs = 0.90 + 0.12 * (np.arange(size) // 2 % 2) * value_noise(rng, size, (size // 2, 12))
    yarn = value_noise(rng, size, (size // 2, 5)) + value_noise(rng, size, (9, size // 2)) - 1
    waves = fractal(rng, size, (3, 4), 3) - 0.5
    tone = ribs + 0.16 * yarn + 0.16 * waves
    end = np.minimum(at, 1 - at)
    for middle, half in ((0.08, 0.012), (0.13, 0.026), (0.18, 0.012)):
        dye = rng.choice([-0.30, 0.24])
        tone *= 1 + (dye * np.clip((half - np.abs(end - middle)) * size / 2 + 0.5, 0, 1))[None]
    for x, y in rng.uniform(0.2, 0.8, (2, 2)):
        ring = np.hypot(at[None] - x, (at[:, None] - y) * 0.55) - 0.10
        tone *= 1 - 0.10 * np.exp(-((ring * 60) ** 2))
    return toned(colour, tone)


def upper(rng: Generator, size: int, colour: Colour) -> Field:
    """A shoe's upper, u from flank to flank, v from toe (0) to heel."""
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at * 12 / 11, at)
    side = np.minimum(np.abs(u), np.abs(1 - u)) * 2  # 0 at the sole, 1 on the ridge
    wave = 0.05 * np.sin(2 * np.pi * v * 2 + rng.uniform(0, 6))
    panels = (
        (v - 0.15 - 0.10 * side, 0.84),  # toe cap
        (0.80 + 0.10 * side - v, 0.78),  # heel counter
        (side - 0.24 - wave, 0.88),  # guard along the sole
        (np.maximum(0.72 - side, np.abs(v - 0.47) - 0.18), 1.13),  # eyelets
        (np.abs(v - 0.55 - 0.20 * side) - 0.035, 0.70),  # a band over the flank
    )
    knit = 0.90 + 0.16 * ((np.floor(v * size / 3) + np.floor(u * size / 3)) % 2)
    tone = (knit * (0.92 + 0.14 * fractal(rng, size, (6, 6), 3))).astype(np.float32)
    holes = np.hypot((u * 44) % 1 - 0.5, (v * 34) % 1 - 0.5) < 0.24
    tone[holes & (v < 0.36) & (side > 0.4) & (v > 0.27)] *= 0.55
    dashes = (np.floor((u + v) * size / 3) % 2) > 0
    leather = 0.95 + 0.08 * fine_noise(rng, size, 3)
    stitch = np.zeros((size, size), bool)
    for edge, shade in panels:
        inside = np.clip(0.5 - edge * size / 1.5, 0, 1)
        tone = tone * (1 - inside) + shade * leather * inside
        tone = tone * (1 - 0.45 * np.exp(-((edge * size / 1.6) ** 2)))  # the seam
        stitch |= (np.abs(edge + 0.022) < 0.0045) & dashes
    skin = toned(colour, tone)
    skin[stitch] = skin[stitch] * 0.4 + 0.6 * (0.25 if float(colour.mean()) > 0.6 else 0.85)
    dirt = np.clip(1.0 - side * 5, 0, 1) * fractal(rng, size, (8, 8), 3)
    return skin * (1 - 0.35 * dirt)[..., None].astype(np.float32)


SKINS: dict[str, Callable[[Generator, int, Colour], Field]] = by_name(
    wicker, cord, crust, turned, shell, runner, upper
)


def skin(kind: str, seed: int, colour: ArrayLike, size: int) -> Rgba:
    """The named skin (size,size,4) for a colour (3,), sRGB 0-1."""
    rng = np.random.Generator(np.random.Philox(seed))
    return rgba(SKINS[kind](rng, size, np.asarray(colour, np.float32)))


def packaging(printed: Rgba, ink: ArrayLike, seed: int, busy: bool) -> Rgba:
    """A used print (N,N,4): gradients, worn edges; if `busy` small print, bar code, picture."""
    rng = np.random.Generator(np.random.Philox(seed))
    canvas, n = printed[..., :3].astype(np.float32) / 255, len(printed)
    at = np.linspace(0, 1, n, dtype=np.float32)
    canvas *= (1.07 - 0.16 * at)[:, None, None]
    if busy:
        _picture(canvas, rng, np.asarray(ink, np.float32))
        _small_print(canvas, rng)
    rub = np.clip(1 - border(at) / (0.008 + 0.03 * fine_noise(rng, n, 6) ** 2), 0, 1) * 0.45
    scuff = np.clip(fractal(rng, n, (5, 9), 4) - 0.72, 0, 1) * 0.7
    canvas += (np.array([0.86, 0.84, 0.80], np.float32) - canvas) * (rub + scuff)[..., None]
    canvas *= (0.96 + 0.08 * fine_noise(rng, n, 2))[..., None]
    return rgba(canvas)


def _picture(canvas: Field, rng: Generator, ink: Colour) -> None:
    n = len(canvas)
    y, x = np.mgrid[:n, :n].astype(np.float32) / n
    hue = np.clip(ink * 0.6 + rng.uniform(0.1, 0.5, 3), 0, 1)
    for low in (0.17, 0.83):
        for _ in range(int(rng.integers(2, 5))):
            cx, cy = rng.uniform(0.15, 0.85), low + rng.uniform(-0.05, 0.05)
            r = rng.uniform(0.05, 0.10)
            d = np.hypot(x - cx, y - cy) / r
            lit = np.clip(1.15 - 0.65 * np.hypot(x - cx + 0.4 * r, y - cy + 0.4 * r) / r, 0.25, 1.2)
            inside = np.clip((1 - d) * r * n / 1.5, 0, 1)[..., None]
            ball = np.clip(hue * rng.uniform(0.8, 1.2, 3) * lit[..., None], 0, 1)
            canvas += (ball - canvas) * inside


def _small_print(canvas: Field, rng: Generator) -> None:
    n = len(canvas)
    for left, top, lines in ((0.06, 0.68, 4), (0.60, 0.30, 3)):
        tone = 0.12 if float(canvas[int(top * n), int(left * n)].mean()) > 0.45 else 0.92
        for row in range(lines):
            y, x = int((top + 0.028 * row) * n), left
            while x < left + rng.uniform(0.22, 0.32):
                width = rng.uniform(0.015, 0.06)
                word = canvas[y : y + max(n // 90, 1), int(x * n) : int((x + width) * n)]
                word += (tone - word) * 0.7
                x += width + 0.012
    x, y, width, height = int(0.72 * n), int(0.86 * n), int(0.22 * n), int(0.09 * n)
    canvas[y : y + height, x : x + width] = 0.92
    bars = np.repeat(rng.random(n) < 0.5, max(n // 128, 1))[: width - 4]
    canvas[y + 1 : y + height - 2, x + 2 : x + 2 + len(bars)][:, bars] = 0.1
    canvas[:] = cv2.GaussianBlur(canvas, (3, 3), 0.45)

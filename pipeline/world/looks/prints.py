"""Square designs of packaging, screens and signs, drawn from a seed."""

import cv2
import numpy as np
from numpy.random import Generator

from .skins import packaging
from .textures import Field, Rgba, border, by_name, chequered, fine_noise, mix, rgba, value_noise

Triple = tuple[float, float, float]
Share = tuple[float, float]
BUSY = frozenset({"label", "product", "stripes", "dots", "diamond"})
HANDLED = BUSY | {"worn"}
"""Kinds with pictures and small print, and those that show handling."""


def printing(base: Triple, accent: Triple, kind: str, text: str, seed: int, size: int) -> Rgba:
    """The unused design (size,size,4): ink `accent` on ground `base` (sRGB 0-1)."""
    rng = np.random.Generator(np.random.Philox(seed))
    grain = fine_noise(rng, size, 2)
    ground, ink = np.array(base, np.float32), np.array(accent, np.float32)
    canvas = np.ascontiguousarray(mix(ground * 1.02, ground * 0.98, grain), np.float32)
    PRINTS[kind](canvas, ink, text, rng)
    return rgba(canvas)


def handled(base: Triple, accent: Triple, kind: str, text: str, seed: int, size: int) -> Rgba:
    """The same after use: pictures, small print and worn edges if its kind has them."""
    design = printing(base, accent, kind, text, seed, size)
    return packaging(design, accent, seed, kind in BUSY) if kind in HANDLED else design


def _write(canvas: Field, text: str, centre_y: float, color: Field, height: float) -> None:
    if not text:
        return
    size, font = len(canvas), cv2.FONT_HERSHEY_DUPLEX
    scale, thick = height * size / 22.0, max(1, size // 64)
    (width, tall), _ = cv2.getTextSize(text, font, scale, thick)
    scale *= min(1.0, 0.92 * size / width)
    (width, tall), _ = cv2.getTextSize(text, font, scale, thick)
    origin = (int((size - width) / 2), int(centre_y * size + tall / 2))
    cv2.putText(canvas, text, origin, font, scale, color.tolist(), thick, cv2.LINE_AA)


def _fill(canvas: Field, colour: Field, *rows: Share, across: Share = (0.0, 1.0)) -> None:
    """Colour `rows` and the columns `across`, shares of the height and of the width."""
    n, (left, right) = len(canvas), across
    for top, bottom in rows:
        canvas[int(top * n) : int(bottom * n), int(left * n) : int(right * n)] = colour


def _readable(ink: Field) -> Field:
    return np.full(3, 0.95 if float(ink @ [0.3, 0.6, 0.1]) < 0.55 else 0.08, np.float32)


def _plate(canvas: Field, ink: Field, text: str) -> None:
    if text:
        _fill(canvas, ink, (0.38, 0.62))
    _write(canvas, text, 0.5, _readable(ink), 0.18)


def _label(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    _fill(canvas, ink, (0.3, 0.7), (0.25, 0.27), (0.73, 0.75))
    _write(canvas, text, 0.5, _readable(ink), 0.2)


def _product(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    n, paper = len(canvas), np.array([0.93, 0.92, 0.88], np.float32)
    _fill(canvas, ink, (0.16, 0.56), (0.11, 0.13))
    _fill(canvas, paper, (0.60, 0.94), across=(0.08, 0.92))
    _write(canvas, text, 0.36, _readable(ink), 0.24)
    for y in (np.arange(0.65, 0.90, 0.05) * n).astype(int):
        line = canvas[y : y + max(1, n // 64), int(0.12 * n) : int(rng.uniform(0.36, 0.52) * n)]
        line[:] = paper * 0.45
    bars = np.repeat(rng.random(n) < 0.5, 2)[: int(0.3 * n)]
    canvas[int(0.64 * n) : int(0.90 * n), int(0.58 * n) : int(0.58 * n) + len(bars)][:, bars] = 0.08


def _worn(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    n = len(canvas)
    rub = np.clip(
        1.2 - border((np.arange(n) + 0.5) / n) / (0.02 + 0.05 * fine_noise(rng, n, 6)), 0, 0.3
    )
    share = rub + np.clip(value_noise(rng, n, (n // 2, 6)) - 0.85, 0, 1) * 0.5
    cloud = 0.97 + 0.05 * value_noise(rng, n, (5, 5))
    fading = (ink * 0.5 + canvas * 0.5 - canvas) * share[..., None].astype(np.float32)
    canvas[:] = canvas * cloud[..., None] + fading


def _hem(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    n = len(canvas)
    weave = 0.90 + 0.12 * chequered(np.arange(n) // 2) * fine_noise(rng, n, 3)
    canvas *= weave[..., None].astype(np.float32)
    low, high, dash = int(0.05 * n), int(0.95 * n), np.arange(n) % 8 < 5
    inside = dash & (np.arange(n) >= low) & (np.arange(n) <= high)
    for k in (low, low + 1, high - 1, high):
        canvas[k, inside] = ink
        canvas[inside, k] = ink


def _stripes(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    bands = int(rng.integers(3, 6))
    _fill(canvas, ink, *(((k + 0.3) / bands, (k + 0.7) / bands) for k in range(bands)))
    _plate(canvas, ink, text)


def _dots(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    n = len(canvas)
    for k in range(25):
        centre = (int((k % 5 + 0.5 * (k // 5 % 2) + 0.25) / 5 * n), int((k // 5 + 0.5) / 5 * n))
        cv2.circle(canvas, centre, n // 16, ink.tolist(), -1, cv2.LINE_AA)
    _plate(canvas, ink, text)


def _diamond(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    n = len(canvas)
    half, low, high = n // 2, n // 8, 7 * n // 8
    corners = np.array([[half, low], [high, half], [half, high], [low, half]])
    cv2.fillPoly(canvas, [corners], ink.tolist())
    _write(canvas, text, 0.5, _readable(ink), 0.16)


def _qr(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    modules = 21
    grid = rng.random((modules, modules)) < 0.5
    for y, x in ((0, 0), (0, modules - 7), (modules - 7, 0)):
        grid[max(y - 1, 0) : y + 8, max(x - 1, 0) : x + 8] = False
        grid[y : y + 7, x : x + 7] = True
        grid[y + 1 : y + 6, x + 1 : x + 6] = False
        grid[y + 2 : y + 5, x + 2 : x + 5] = True
    quiet = np.pad(grid, 2)
    index = np.arange(len(canvas)) * quiet.shape[0] // len(canvas)
    canvas[:] = np.where(quiet[index][:, index, None], np.minimum(ink, 0.2), 0.96)


def _keys(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    n, rows, columns = len(canvas), 6, 3
    for r in range(rows):
        for c in range(columns):
            middle = (int((c + 0.5) / columns * n), int((r + 0.5) / rows * n))
            tone = ink if (r, c) != (0, 0) else np.array([0.8, 0.1, 0.1], np.float32)
            axes = (int(0.11 * n), int(0.05 * n))
            cv2.ellipse(canvas, middle, axes, 0, 0, 360, tone.tolist(), -1, cv2.LINE_AA)


def _panel(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    _fill(canvas, np.array([0.06, 0.09, 0.11], np.float32), (0.08, 0.92), across=(0.06, 0.94))
    _write(canvas, text, 0.5, ink, 0.26)


def _pressed(canvas: Field, ink: Field, text: str, rng: Generator) -> None:
    n, ground = len(canvas), canvas[0, 0].copy()
    for shift, tone in ((n // 90 + 1, np.minimum(ground * 1.15 + 0.04, 1)), (0, ink)):
        stamped = np.zeros((n, n), np.float32)
        middle, axes, thick = (n // 2, n // 2), (int(0.46 * n), int(0.42 * n)), max(n // 40, 1)
        cv2.ellipse(stamped, middle, axes, 0, 0, 360, 1.0, thick, cv2.LINE_AA)
        _write(stamped, text, 0.5, np.ones(1), 0.36)
        canvas += (tone - canvas) * np.roll(stamped, shift, 0)[..., None]


PRINTS = by_name(
    _label, _product, _worn, _hem, _stripes, _dots, _diamond, _qr, _keys, _panel, _pressed
)

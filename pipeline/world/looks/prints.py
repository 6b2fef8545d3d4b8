"""Square designs of packaging, screens and signs, drawn from a seed."""

import cv2
import numpy as np
from numpy.random import Generator

from .skins import packaging
from .textures import Rgba, by_name, mix, rgba, value_noise

Triple = tuple[float, float, float]
BUSY = frozenset({"label", "product", "stripes", "dots", "diamond"})
HANDLED = BUSY | {"worn"}
"""Kinds with pictures and small print, and those that show handling."""


def printing(base: Triple, accent: Triple, kind: str, text: str, seed: int, size: int) -> Rgba:
    """The unused design (size,size,4): ink `accent` on ground `base` (sRGB 0-1)."""
    rng = np.random.Generator(np.random.Philox(seed))
    grain = value_noise(rng, size, (size // 2, size // 2))
    ground, ink = np.array(base, np.float32), np.array(accent, np.float32)
    canvas = np.ascontiguousarray(mix(ground * 1.02, ground * 0.98, grain), np.float32)
    PRINTS[kind](canvas, ink, text, rng)
    return rgba(canvas)


def handled(base: Triple, accent: Triple, kind: str, text: str, seed: int, size: int) -> Rgba:
    """The same after use: pictures, small print and worn edges if its kind has them."""
    design = printing(base, accent, kind, text, seed, size)
    return packaging(design, accent, seed, kind in BUSY) if kind in HANDLED else design


def _write(
    canvas: np.ndarray, text: str, centre_y: float, color: np.ndarray, height: float
) -> None:
    if not text:
        return
    size = canvas.shape[0]
    scale, thick = height * size / 22.0, max(1, size // 64)
    (width, tall), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, thick)
    fit = min(1.0, 0.92 * size / width)
    (width, tall), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale * fit, thick)
    origin = (int((size - width) / 2), int(centre_y * size + tall / 2))
    cv2.putText(
        canvas,
        text,
        origin,
        cv2.FONT_HERSHEY_DUPLEX,
        scale * fit,
        color.tolist(),
        thick,
        cv2.LINE_AA,
    )


def _readable(ink: np.ndarray) -> np.ndarray:
    return np.full(3, 0.95 if float(ink @ [0.3, 0.6, 0.1]) < 0.55 else 0.08, np.float32)


def _plate(canvas: np.ndarray, ink: np.ndarray, text: str) -> None:
    n = canvas.shape[0]
    if text:
        canvas[int(0.38 * n) : int(0.62 * n)] = ink
    _write(canvas, text, 0.5, _readable(ink), 0.18)


def _label(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n = canvas.shape[0]
    canvas[int(0.3 * n) : int(0.7 * n)] = ink
    canvas[int(0.25 * n) : int(0.27 * n)] = ink
    canvas[int(0.73 * n) : int(0.75 * n)] = ink
    _write(canvas, text, 0.5, _readable(ink), 0.2)


def _product(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n = canvas.shape[0]
    paper = np.array([0.93, 0.92, 0.88], np.float32)
    canvas[int(0.16 * n) : int(0.56 * n)] = ink
    canvas[int(0.11 * n) : int(0.13 * n)] = ink
    canvas[int(0.60 * n) : int(0.94 * n), int(0.08 * n) : int(0.92 * n)] = paper
    _write(canvas, text, 0.36, _readable(ink), 0.24)
    for row in np.arange(0.65, 0.90, 0.05):
        canvas[
            int(row * n) : int(row * n) + max(1, n // 64),
            int(0.12 * n) : int(rng.uniform(0.36, 0.52) * n),
        ] = paper * 0.45
    bars = np.repeat(rng.random(n) < 0.5, 2)[: int(0.3 * n)]
    canvas[int(0.64 * n) : int(0.90 * n), int(0.58 * n) : int(0.58 * n) + len(bars)][:, bars] = 0.08


def _worn(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n = canvas.shape[0]
    at = (np.arange(n) + 0.5) / n
    border = np.minimum(np.minimum(at, 1 - at)[:, None], np.minimum(at, 1 - at)[None])
    rub = value_noise(rng, n, (n // 6, n // 6))
    share = (
        np.clip(1.2 - border / (0.02 + 0.05 * rub), 0, 0.3)
        + np.clip(value_noise(rng, n, (n // 2, 6)) - 0.85, 0, 1) * 0.5
    )
    cloud = 0.97 + 0.05 * value_noise(rng, n, (5, 5))
    canvas[:] = canvas * cloud[..., None] + (ink * 0.5 + canvas * 0.5 - canvas) * share[
        ..., None
    ].astype(np.float32)


def _hem(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n = canvas.shape[0]
    thread = np.arange(n) // 2
    weave = 0.90 + 0.12 * ((thread[:, None] + thread[None]) % 2) * value_noise(
        rng, n, (n // 3, n // 3)
    )
    canvas *= weave[..., None].astype(np.float32)
    low, high, dash = int(0.05 * n), int(0.95 * n), np.arange(n) % 8 < 5
    inside = dash & (np.arange(n) >= low) & (np.arange(n) <= high)
    for k in (low, low + 1, high - 1, high):
        canvas[k, inside] = ink
        canvas[inside, k] = ink


def _stripes(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n, bands = canvas.shape[0], int(rng.integers(3, 6))
    for k in range(bands):
        canvas[int((k + 0.3) / bands * n) : int((k + 0.7) / bands * n)] = ink
    _plate(canvas, ink, text)


def _dots(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n = canvas.shape[0]
    for k in range(25):
        centre = (int((k % 5 + 0.5 * (k // 5 % 2) + 0.25) / 5 * n), int((k // 5 + 0.5) / 5 * n))
        cv2.circle(canvas, centre, n // 16, ink.tolist(), -1, cv2.LINE_AA)
    _plate(canvas, ink, text)


def _diamond(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n = canvas.shape[0]
    cv2.fillPoly(
        canvas,
        [
            np.array(
                [[n // 2, n // 8], [7 * n // 8, n // 2], [n // 2, 7 * n // 8], [n // 8, n // 2]]
            )
        ],
        ink.tolist(),
    )
    _write(canvas, text, 0.5, _readable(ink), 0.16)


def _qr(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    modules = 21
    grid = rng.random((modules, modules)) < 0.5
    for y, x in ((0, 0), (0, modules - 7), (modules - 7, 0)):
        grid[max(y - 1, 0) : y + 8, max(x - 1, 0) : x + 8] = False
        grid[y : y + 7, x : x + 7] = True
        grid[y + 1 : y + 6, x + 1 : x + 6] = False
        grid[y + 2 : y + 5, x + 2 : x + 5] = True
    quiet = np.pad(grid, 2)
    index = np.arange(canvas.shape[0]) * quiet.shape[0] // canvas.shape[0]
    canvas[:] = np.where(quiet[index][:, index, None], np.minimum(ink, 0.2), 0.96)


def _keys(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n, rows, columns = canvas.shape[0], 6, 3
    for r in range(rows):
        for c in range(columns):
            y, x = (r + 0.5) / rows * n, (c + 0.5) / columns * n
            tone = ink if (r, c) != (0, 0) else np.array([0.8, 0.1, 0.1], np.float32)
            cv2.ellipse(
                canvas,
                (int(x), int(y)),
                (int(0.11 * n), int(0.05 * n)),
                0,
                0,
                360,
                tone.tolist(),
                -1,
                cv2.LINE_AA,
            )


def _panel(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    n = canvas.shape[0]
    canvas[int(0.08 * n) : int(0.92 * n), int(0.06 * n) : int(0.94 * n)] = np.array(
        [0.06, 0.09, 0.11], np.float32
    )
    _write(canvas, text, 0.5, ink, 0.26)


def _pressed(canvas: np.ndarray, ink: np.ndarray, text: str, rng: Generator) -> None:
    """Pressed words and oval: dark above, light below."""
    n, ground = canvas.shape[0], canvas[0, 0].copy()
    for shift, tone in ((n // 90 + 1, np.minimum(ground * 1.15 + 0.04, 1)), (0, ink)):
        stamped = np.zeros((n, n), np.float32)
        cv2.ellipse(
            stamped,
            (n // 2, n // 2),
            (int(0.46 * n), int(0.42 * n)),
            0,
            0,
            360,
            1.0,
            max(n // 40, 1),
            cv2.LINE_AA,
        )
        _write(stamped, text, 0.5, np.ones(1), 0.36)
        canvas += (tone - canvas) * np.roll(stamped, shift, 0)[..., None]


PRINTS = by_name(
    _label, _product, _worn, _hem, _stripes, _dots, _diamond, _qr, _keys, _panel, _pressed
)

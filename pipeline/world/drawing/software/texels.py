"""Textures and the noise of worn surfaces, read per pixel."""

import numpy as np

from pipeline.poses import Floats32

from .kernels import kernel
from .light import I32, F, Geometry, Texels, U


@kernel
def byte(word, shift):
    """One of a word's four bytes, 0-255."""
    return F(I32(U(U(word >> U(shift)) & U(255))))


@kernel
def mixed(words, wa, wb, wc, wd):
    """Red, green and blue 0-1 of four texels with these weights."""
    a, b, c, d = words
    red = byte(a, 0) * wa + byte(b, 0) * wb + byte(c, 0) * wc + byte(d, 0) * wd
    green = byte(a, 8) * wa + byte(b, 8) * wb + byte(c, 8) * wc + byte(d, 8) * wd
    blue = byte(a, 16) * wa + byte(b, 16) * wb + byte(c, 16) * wc + byte(d, 16) * wd
    scale = F(1 / 255)
    return red * scale, green * scale, blue * scale


@kernel
def square(x, y):
    h = U(U(x) * U(73856093)) ^ U(U(y) * U(19349663))
    h = U(U(h ^ U(h >> U(13))) * U(1540483477))
    return F(I32(U(h >> U(16)) & U(255))) * F(1 / 255)


@kernel
def sampled(texels: Texels, texture: int, u, v):
    """Bilinear colour 0-1 of a repeating texture."""
    first, width, height = (
        texels.places[texture, 0],
        texels.places[texture, 1],
        texels.places[texture, 2],
    )
    x, y = (u - np.floor(u)) * F(width) - F(0.5), (v - np.floor(v)) * F(height) - F(0.5)
    lx, ly = np.floor(x), np.floor(y)
    fx, fy = x - lx, y - ly
    x0, y0 = I32(lx), I32(ly)
    x1, y1 = x0 + 1, y0 + 1
    x0 = width - 1 if x0 < 0 else x0
    y0 = height - 1 if y0 < 0 else y0
    x1 = 0 if x1 >= width else x1
    y1 = 0 if y1 >= height else y1
    a, b = texels.words[U(first + y0 * width + x0)], texels.words[U(first + y0 * width + x1)]
    c, d = texels.words[U(first + y1 * width + x0)], texels.words[U(first + y1 * width + x1)]
    wa, wb = (F(1) - fx) * (F(1) - fy), fx * (F(1) - fy)
    wc, wd = (F(1) - fx) * fy, fx * fy
    return mixed((a, b, c, d), wa, wb, wc, wd)


@kernel
def level_of(geometry: Geometry, t: int, seen: Floats32) -> int:
    """How often a triangle's texture was halved, so that no edge has more texels than pixels."""
    texture = int(geometry.materials[geometry.material[t], 5])
    places, uvs, corners = geometry.texels.places, geometry.uvs, geometry.corners
    wide, high, most = F(places[texture, 1]), F(places[texture, 2]), F(0)
    for k in range(3):
        i, j = corners[t, k], corners[t, (k + 1) % 3]
        u, v = (uvs[i, 0] - uvs[j, 0]) * wide, (uvs[i, 1] - uvs[j, 1]) * high
        x, y = seen[i, 3] - seen[j, 3], seen[i, 4] - seen[j, 4]
        most = max(most, (u * u + v * v) / max(x * x + y * y, F(1e-6)))
    level, bound = 0, F(2)  # squares of the root of two, twice that, ...
    while most > bound and level < places[texture, 3] - 1:
        level += 1
        bound *= F(4)
    return level

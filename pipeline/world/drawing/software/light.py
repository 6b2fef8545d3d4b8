"""Light on bodies and on the room's planes, with the formulas of shaders/common. Pixels are shaded
in groups, quantity by quantity, so that the compiler takes several at once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Floats32, Pixels
from pipeline.world.physics.body import TABLE_TOP

from ..masks import BLOCK
from .kernels import kernel
from .raster import Frame, Ids, Lens

F, I32, U = np.float32, np.int32, np.uint32
NEAREST = 4  # texels a side of what `surrounding` tells the depths of
GROUP = 256  # pixels whose quantities stay in the fastest cache
# rows of a group's quantities
NX, NY, NZ, OPEN, LX, LY, LZ, WX, WY, WZ = (GROUP * k for k in range(10))
RED, GREEN, BLUE, ROUGH, METAL, WEAR = (GROUP * k for k in range(10, 16))
VX, VY, VZ, NV, COSINE, ARRIVES, WIDE, BULGE = (GROUP * k for k in range(16, 24))
DR, DG, DB, MR, MG, MB, SX, SY, SZ, VIGNETTE = (GROUP * k for k in range(24, 34))
ROWS = GROUP * 34
GROUND = F(TABLE_TOP)


class Texels(NamedTuple):
    """All textures, RGBA in words, and for each its first texel, width, height, and levels."""

    words: NDArray[np.uint32]
    places: NDArray[np.int32]


class Geometry(NamedTuple):
    """Triangles of all bodies: corners (M,3), material (M,); at each vertex (N,8) the world normal,
    share of room light, and place in the body; uvs (N,2); materials (K,6): albedo, roughness,
    metallic, texture or -1."""

    corners: Ids
    material: Ids
    vertices: Floats32
    uvs: Floats32
    materials: Floats32
    texels: Texels


class Lamps(NamedTuple):
    """Ambient light, sunward direction, sun, light that the table scatters, (4,3), and point
    lights (P,6): place and colour."""

    room: Floats32
    points: Floats32


class Sunlight(NamedTuple):
    """Depths along the light (N,N), with the least and most around each 4 x 4 texels. `move` (3,4)
    takes the world to the map. `masks` (N,N) are light on table and floor, four bytes a word.
    Without shadows `drawn` is False."""

    depths: Floats32
    least: Floats32
    most: Floats32
    move: Floats32
    masks: NDArray[np.uint32]
    drawn: bool


class Canvas(NamedTuple):
    """An image (H*W,4), and the block of the maps that each pixel was lit from (H*W,)."""

    image: Pixels
    blocks: NDArray[np.uint16]


@kernel
def highlight(nl, nv, lv, bulge, height):
    square = max(F(2) + F(2) * lv, F(0.04))
    total = nl + nv
    q = total * total * bulge + square
    return height * square / (q * q)


@kernel
def clamped(x):
    return min(max(x, F(0)), F(1))


@kernel
def place_pixels(s: Floats32, pixels: Ids, frame: Frame, camera: tuple[Floats32, Lens]) -> None:
    """World places, directions to the camera and the lens's shade of pixels. The first part of the
    camera (3,4) is its axes and place in the world."""
    view, lens = camera
    pixel, cx, cy = F(1 / lens.focal), F(lens.width / 2), F(lens.height / 2)
    r00, r01, r02, c0 = view[0, 0], view[0, 1], view[0, 2], view[0, 3]
    r10, r11, r12, c1 = view[1, 0], view[1, 1], view[1, 2], view[1, 3]
    r20, r21, r22, c2 = view[2, 0], view[2, 1], view[2, 2], view[2, 3]
    by_width = F(1 / lens.width)
    for k in range(len(pixels)):
        p = pixels[k]
        row = p // lens.width
        ox, oy = F(p - row * lens.width) + F(0.5) - cx, F(row) + F(0.5) - cy
        x, y, z = ox * pixel, oy * pixel, F(1) / frame.inverse[U(p)]
        dx = r00 * x + r01 * y + r02
        dy = r10 * x + r11 * y + r12
        dz = r20 * x + r21 * y + r22
        s[WX + k], s[WY + k], s[WZ + k] = c0 + dx * z, c1 + dy * z, c2 + dz * z
        back = F(-1) / np.sqrt(dx * dx + dy * dy + dz * dz)
        s[VX + k], s[VY + k], s[VZ + k] = dx * back, dy * back, dz * back
        s[VIGNETTE + k] = F(1) - F(0.55) * (ox * ox + oy * oy) * (by_width * by_width)


@kernel
def _response(x):
    over = max(x - F(0.65), F(0))
    light = min(x, F(0.65)) + over * F(0.35) / (over + F(0.35))
    return (np.sqrt(light) * (F(0.7) - F(0.6) * light) + F(0.9) * light) * F(255) + F(0.5)


@kernel
def display(s: Floats32, n: int) -> None:
    """Radiance in DR, DG and DB as the camera shows it, 0.5 to 255.5."""
    for k in range(n):
        red, green, blue, shade = s[DR + k], s[DG + k], s[DB + k], s[VIGNETTE + k]
        grey = red * F(0.025) + green * F(0.062) + blue * F(0.013)
        s[DR + k] = _response((red * F(0.9) + grey) * shade)
        s[DG + k] = _response((green * F(0.9) + grey) * shade)
        s[DB + k] = _response((blue * F(0.9) + grey) * shade)


@kernel
def write(s: Floats32, pixels: Ids, size: int, out: Canvas) -> None:
    image, last = out.image, I32(size - 1)
    for k in range(len(pixels)):
        p = pixels[k]
        x, y = min(max(I32(s[SX + k]), I32(0)), last), min(max(I32(s[SY + k]), I32(0)), last)
        out.blocks[p] = (y // BLOCK) * (size // BLOCK) + x // BLOCK
        image[p, 0] = np.uint8(I32(s[DR + k]))
        image[p, 1] = np.uint8(I32(s[DG + k]))
        image[p, 2] = np.uint8(I32(s[DB + k]))

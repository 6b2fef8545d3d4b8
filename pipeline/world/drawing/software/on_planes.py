"""Light on the room's planes, as in shaders/common/plane.glsl, with all of it per pixel."""

import numpy as np
from numpy.typing import NDArray

from pipeline.poses import Floats32

from .kernels import kernel
from .light import (
    ARRIVES,
    BLUE,
    COSINE,
    DB,
    DG,
    DR,
    GREEN,
    GROUP,
    I32,
    LZ,
    MB,
    MG,
    MR,
    NV,
    OPEN,
    RED,
    ROUGH,
    ROWS,
    SX,
    SY,
    VX,
    VY,
    VZ,
    WX,
    WY,
    WZ,
    Canvas,
    F,
    Lamps,
    Sunlight,
    Texels,
    U,
    clamped,
    display,
    highlight,
    place_pixels,
    write,
)
from .raster import Frame, Ids, Lens
from .texels import byte, mixed

FX, FY = LZ, ROUGH  # of planes, which have neither
W0, W1, W2, W3 = (GROUP * k for k in range(4))  # places and then contents of four texels


@kernel
def _texture(s: Floats32, w: NDArray[np.uint32], n: int, row: Floats32, texels: Texels) -> None:
    """Albedo by bilinear colours of a plane's texture."""
    place = texels.places[int(row[7])]
    first, wide, high = place[0], place[1], place[2]
    ux, uy, uz, u0, vx, vy, vz, v0 = (
        row[8],
        row[9],
        row[10],
        row[11],
        row[12],
        row[13],
        row[14],
        row[15],
    )
    fw, fh, last_x, last_y = F(wide), F(high), I32(wide - 1), I32(high - 1)
    for k in range(n):
        x, y, z = s[WX + k], s[WY + k], s[WZ + k]
        u, v = ux * x + uy * y + uz * z + u0, vx * x + vy * y + vz * z + v0
        x, y = (u - np.floor(u)) * fw - F(0.5), (v - np.floor(v)) * fh - F(0.5)
        lx, ly = np.floor(x), np.floor(y)
        s[FX + k], s[FY + k] = x - lx, y - ly
        x0, y0 = I32(lx), I32(ly)
        x1, y1 = I32(x0 + I32(1)), I32(y0 + I32(1))
        x0 = last_x if x0 < I32(0) else x0
        y0 = last_y if y0 < I32(0) else y0
        x1 = I32(0) if x1 > last_x else x1
        y1 = I32(0) if y1 > last_y else y1
        top, bottom = I32(first + y0 * wide), I32(first + y1 * wide)
        w[W0 + k], w[W1 + k] = U(top + x0), U(top + x1)
        w[W2 + k], w[W3 + k] = U(bottom + x0), U(bottom + x1)
    words = texels.words
    for k in range(n):
        w[W0 + k], w[W1 + k] = words[w[W0 + k]], words[w[W1 + k]]
        w[W2 + k], w[W3 + k] = words[w[W2 + k]], words[w[W3 + k]]
    for k in range(n):
        fx, fy = s[FX + k], s[FY + k]
        wd = fx * fy
        wb, wc = fx - wd, fy - wd
        wa = F(1) - fx - wc
        four = w[W0 + k], w[W1 + k], w[W2 + k], w[W3 + k]
        red, green, blue = mixed(four, wa, wb, wc, wd)
        s[RED + k], s[GREEN + k], s[BLUE + k] = red * red, green * green, blue * blue


@kernel
def _masked(
    s: Floats32,
    w: NDArray[np.uint32],
    n: int,
    plane: tuple[int, np.float32],
    masks: NDArray[np.uint32],
) -> None:
    """Bilinear sunlight on table (channel 0) or floor (1), and room light on the table."""
    size = masks.shape[0]
    channel, facing = plane
    last, flat = I32(size - 1), masks.ravel()
    for k in range(n):
        x, y = s[SX + k] - F(0.5), s[SY + k] - F(0.5)
        lx, ly = np.floor(x), np.floor(y)
        s[FX + k], s[FY + k] = x - lx, y - ly
        x0, y0 = I32(lx), I32(ly)
        x1, y1 = min(max(I32(x0 + I32(1)), I32(0)), last), min(max(I32(y0 + I32(1)), I32(0)), last)
        x0, y0 = min(max(x0, I32(0)), last), min(max(y0, I32(0)), last)
        top, bottom = I32(y0 * I32(size)), I32(y1 * I32(size))
        w[W0 + k], w[W1 + k] = U(top + x0), U(top + x1)
        w[W2 + k], w[W3 + k] = U(bottom + x0), U(bottom + x1)
    for k in range(n):
        w[W0 + k], w[W1 + k] = flat[w[W0 + k]], flat[w[W1 + k]]
        w[W2 + k], w[W3 + k] = flat[w[W2 + k]], flat[w[W3 + k]]
    scale, shift = F(1 / 255), 8 * channel
    on_table, facing = F(1 - channel), facing * scale
    for k in range(n):
        fx, fy = s[FX + k], s[FY + k]
        wd = fx * fy
        wb, wc = fx - wd, fy - wd
        wa = F(1) - fx - wc
        a, b, c, d = w[W0 + k], w[W1 + k], w[W2 + k], w[W3 + k]
        sun = byte(a, shift) * wa + byte(b, shift) * wb
        sun += byte(c, shift) * wc + byte(d, shift) * wd
        opened = byte(a, 16) * wa + byte(b, 16) * wb + byte(c, 16) * wc + byte(d, 16) * wd
        s[ARRIVES + k] = sun * facing
        s[OPEN + k] = F(1) + on_table * (opened * scale - F(1))


@kernel
def shade_plane(
    pixels: Ids,
    frame: Frame,
    camera: tuple[Floats32, Lens],
    plane: tuple[Floats32, Texels],
    light: tuple[Lamps, Sunlight],
    out: Canvas,
) -> None:
    """Colours of pixels that show one plane. Its row: normal (3), albedo (3), roughness, texture or
    -1, u and v by place in the world (2,4), channel of the masks."""
    lamps, sunlight = light
    row, texels = plane
    s, w = np.empty(ROWS, np.float32), np.empty(4 * GROUP, np.uint32)
    room, points, move = lamps.room, lamps.points, sunlight.move
    nx, ny, nz = row[0], row[1], row[2]
    texture, channel = int(row[7]), int(row[16])
    a = row[6] * row[6]
    bulge, tall = a * a - F(1), F(2) * a * a / (F(2) * a + F(1))
    sx, sy, sz = room[1, 0], room[1, 1], room[1, 2]
    across = F(1) - abs(nz)
    facing = max(nx * sx + ny * sy + nz * sz, F(0))
    f0, smooth = F(0.04), (F(1) - a) * (F(1) - a) * F(0.2)
    for start in range(0, len(pixels), GROUP):
        part = pixels[start : start + GROUP]
        n = len(part)
        place_pixels(s, part, frame, camera)
        for k in range(n):
            x, y, z = s[WX + k], s[WY + k], s[WZ + k]
            nv = max(nx * s[VX + k] + ny * s[VY + k] + nz * s[VZ + k], F(0))
            s[NV + k] = nv
            near = F(1) + F(0.16) * (x * sx + y * sy)
            behind = min(max(F(0.3) + F(0.7) * (z - F(0.2)), F(0.5)), F(1))
            behind += (F(1) - behind) * abs(nz)
            room_light = (F(1) + F(0.7) * across) * min(max(near, F(0.6)), F(1.4)) * behind
            up = F(2) * nv * nz - s[VZ + k]
            grazing = (F(1) - nv) * (F(1) - nv)
            mirrored = F(0.55) + F(0.65) * clamped(up / (F(0.5) + a) * F(0.5) + F(0.5))
            mirrored *= f0 + smooth * grazing * grazing * (F(1) - f0)
            s[DR + k], s[DG + k], s[DB + k] = (
                room[0, 0] * room_light,
                room[0, 1] * room_light,
                room[0, 2] * room_light,
            )
            s[MR + k], s[MG + k], s[MB + k] = (
                room[0, 0] * mirrored,
                room[0, 1] * mirrored,
                room[0, 2] * mirrored,
            )
            lv = sx * s[VX + k] + sy * s[VY + k] + sz * s[VZ + k]
            s[COSINE + k] = f0 * highlight(facing, nv, lv, bulge, tall)
            ox, oy, oz = x + F(0.004) * nx, y + F(0.004) * ny, z + F(0.004) * nz
            s[SX + k] = move[0, 0] * ox + move[0, 1] * oy + move[0, 2] * oz + move[0, 3]
            s[SY + k] = move[1, 0] * ox + move[1, 1] * oy + move[1, 2] * oz + move[1, 3]
        for i in range(len(points)):
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            red, green, blue = points[i, 3], points[i, 4], points[i, 5]
            for k in range(n):
                x, y, z = px - s[WX + k], py - s[WY + k], pz - s[WZ + k]
                inverse = F(1) / np.sqrt(x * x + y * y + z * z)
                x, y, z = x * inverse, y * inverse, z * inverse
                cosine = max(nx * x + ny * y + nz * z, F(0))
                strength = cosine * inverse * inverse
                lv = x * s[VX + k] + y * s[VY + k] + z * s[VZ + k]
                shine = f0 * strength * highlight(cosine, s[NV + k], lv, bulge, tall)
                s[DR + k] += red * strength
                s[DG + k] += green * strength
                s[DB + k] += blue * strength
                s[MR + k] += red * shine
                s[MG + k] += green * shine
                s[MB + k] += blue * shine
        if texture >= 0:
            _texture(s, w, n, row, texels)
        else:
            for k in range(n):
                s[RED + k], s[GREEN + k], s[BLUE + k] = row[3], row[4], row[5]
        if sunlight.drawn and channel < 2:
            _masked(s, w, n, (channel, facing), sunlight.masks)
        else:
            for k in range(n):
                s[ARRIVES + k], s[OPEN + k] = facing, F(1)
        for k in range(n):
            sun, shine, opened = s[ARRIVES + k], s[COSINE + k], s[OPEN + k]
            red, green, blue = s[RED + k], s[GREEN + k], s[BLUE + k]
            lit = red * s[DR + k] + s[MR + k] + (red + shine) * (sun * room[2, 0])
            s[DR + k] = lit * opened
            lit = green * s[DG + k] + s[MG + k] + (green + shine) * (sun * room[2, 1])
            s[DG + k] = lit * opened
            lit = blue * s[DB + k] + s[MB + k] + (blue + shine) * (sun * room[2, 2])
            s[DB + k] = lit * opened
        display(s, n)
        write(s, part, sunlight.masks.shape[0], out)

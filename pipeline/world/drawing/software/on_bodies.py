"""Light on bodies, as in shaders/common/lit.glsl."""

import numpy as np

from pipeline.poses import Floats32

from .kernels import kernel
from .light import (
    ARRIVES,
    BLUE,
    BULGE,
    COSINE,
    DB,
    DG,
    DR,
    GREEN,
    GROUND,
    GROUP,
    I32,
    LX,
    LY,
    LZ,
    MB,
    METAL,
    MG,
    MR,
    NEAREST,
    NV,
    NX,
    NY,
    NZ,
    OPEN,
    RED,
    ROUGH,
    ROWS,
    SX,
    SY,
    SZ,
    VX,
    VY,
    VZ,
    WEAR,
    WIDE,
    WX,
    WY,
    WZ,
    Canvas,
    F,
    Geometry,
    Lamps,
    Sunlight,
    U,
    clamped,
    display,
    highlight,
    place_pixels,
    write,
)
from .raster import Frame, Ids, Lens
from .texels import level_of, sampled, square


@kernel
def _gather(s: Floats32, pixels: Ids, frame: Frame, geometry: Geometry) -> None:
    vertices, last, level = geometry.vertices, -1, 0
    for k in range(len(pixels)):
        p = pixels[k]
        t = frame.ids[U(p)]
        z = F(1) / frame.inverse[U(p)]
        b, c = frame.first[U(p)] * z, frame.second[U(p)] * z
        a = F(1) - b - c
        corners = geometry.corners[t]
        i, j, h = U(corners[0]), U(corners[1]), U(corners[2])
        s[NX + k] = a * vertices[i, 0] + b * vertices[j, 0] + c * vertices[h, 0]
        s[NY + k] = a * vertices[i, 1] + b * vertices[j, 1] + c * vertices[h, 1]
        s[NZ + k] = a * vertices[i, 2] + b * vertices[j, 2] + c * vertices[h, 2]
        s[OPEN + k] = a * vertices[i, 3] + b * vertices[j, 3] + c * vertices[h, 3]
        s[LX + k] = a * vertices[i, 4] + b * vertices[j, 4] + c * vertices[h, 4]
        s[LY + k] = a * vertices[i, 5] + b * vertices[j, 5] + c * vertices[h, 5]
        s[LZ + k] = a * vertices[i, 6] + b * vertices[j, 6] + c * vertices[h, 6]
        m = geometry.material[t]
        texture = int(geometry.materials[m, 5])
        s[ROUGH + k], s[METAL + k] = geometry.materials[m, 3], geometry.materials[m, 4]
        if texture < 0:
            s[RED + k], s[GREEN + k] = geometry.materials[m, 0], geometry.materials[m, 1]
            s[BLUE + k], s[WEAR + k] = geometry.materials[m, 2], F(1)
        else:
            u = a * geometry.uvs[i, 0] + b * geometry.uvs[j, 0] + c * geometry.uvs[h, 0]
            v = a * geometry.uvs[i, 1] + b * geometry.uvs[j, 1] + c * geometry.uvs[h, 1]
            if t != last:
                last, level = t, level_of(geometry, t, frame.seen)
            texture += level
            red, green, blue = sampled(geometry.texels, texture, u, v)
            s[RED + k], s[GREEN + k], s[BLUE + k] = red * red, green * green, blue * blue
            s[WEAR + k] = F(0)


@kernel
def _surfaces(s: Floats32, n: int, lamps: Lamps, sunlight: Sunlight) -> None:
    """Normals towards the camera, wear, room light, and where shadows are looked up."""
    sx, sy, sz = lamps.room[1, 0], lamps.room[1, 1], lamps.room[1, 2]
    move = sunlight.move
    for k in range(n):
        x, y, z = s[NX + k], s[NY + k], s[NZ + k]
        size = F(1) / np.sqrt(max(x * x + y * y + z * z, F(1e-12)))
        # the map is looked up off the surface
        ox, oy, oz = s[WX + k] + F(0.004) * x, s[WY + k] + F(0.004) * y, s[WZ + k] + F(0.004) * z
        s[SX + k] = move[0, 0] * ox + move[0, 1] * oy + move[0, 2] * oz + move[0, 3]
        s[SY + k] = move[1, 0] * ox + move[1, 1] * oy + move[1, 2] * oz + move[1, 3]
        s[SZ + k] = move[2, 0] * ox + move[2, 1] * oy + move[2, 2] * oz + move[2, 3]
        x, y, z = x * size, y * size, z * size
        nv = x * s[VX + k] + y * s[VY + k] + z * s[VZ + k]
        side = F(-1) if nv < F(0) else F(1)
        x, y, z, nv = x * side, y * side, z * side, nv * side
        s[NX + k], s[NY + k], s[NZ + k], s[NV + k] = x, y, z, nv
        cosine = max(x * sx + y * sy + z * sz, F(0))
        s[COSINE + k] = cosine
        soft = min(cosine * F(1 / 0.3), F(1))
        s[ARRIVES + k] = soft * soft * (F(3) - F(2) * soft)
        height = s[WZ + k] - GROUND
        near = F(0.012) / (F(0.012) + max(height, F(0))) if height > F(-0.001) else F(0)
        s[OPEN + k] *= F(1) - F(0.40) * near * (F(1) - z)
    for k in range(n):
        ax = s[LX + k] + s[LZ + k] * F(0.62)
        ay = s[LY + k] + s[LZ + k] * F(-0.47)
        x, y = ax * F(110) + F(41), ay * F(110) + F(41)
        lx, ly = np.floor(x), np.floor(y)
        fx, fy = x - lx, y - ly
        ix, iy = I32(lx), I32(ly)
        fx, fy = fx * fx * (F(3) - F(2) * fx), fy * fy * (F(3) - F(2) * fy)
        jx, jy = I32(ix + I32(1)), I32(iy + I32(1))
        a, b, c, d = square(ix, iy), square(jx, iy), square(ix, jy), square(jx, jy)
        top, bottom = a + (b - a) * fx, c + (d - c) * fx
        wide = top + (bottom - top) * fy
        fine = square(I32(np.floor(ax * F(620))), I32(np.floor(ay * F(620))))
        rubbed = clamped(F(2.5) * wide - F(1.5)) * s[WEAR + k]
        tone = (F(-0.075) + F(0.10) * wide + F(0.07) * fine) * s[WEAR + k]
        rough = s[ROUGH + k]
        worn = F(1) + (tone + F(0.10) * rubbed) * min(F(2) * rough, F(1))
        s[RED + k] *= worn
        s[GREEN + k] *= worn
        s[BLUE + k] *= worn
        rough += F(0.08) * rubbed
        s[ROUGH + k] = rough * rough


@kernel
def _sun(at_x, at_y, at_z, sunlight: Sunlight):
    """Share of the sun at a texel's coordinates: 16 depths weighted by a cubic B-spline."""
    depths = sunlight.depths
    size = depths.shape[0]
    edge = F(0.01) * F(size)
    if at_x < edge or at_y < edge or at_x > F(size) - edge or at_y > F(size) - edge:
        return F(1)
    z = min(at_z, F(1))
    lx, ly = np.floor(at_x - F(0.5)), np.floor(at_y - F(0.5))
    x, y = int(lx), int(ly)
    if z <= sunlight.least[y // NEAREST, x // NEAREST]:
        return F(1)
    if z > sunlight.most[y // NEAREST, x // NEAREST]:
        return F(0)
    fx, fy = at_x - F(0.5) - lx, at_y - F(0.5) - ly
    gx, gy = F(1) - fx, F(1) - fy
    w0, w3 = gx * gx * gx * F(1 / 6), fx * fx * fx * F(1 / 6)
    w1 = (F(4) - F(6) * fx * fx + F(3) * fx * fx * fx) * F(1 / 6)
    w2 = F(1) - w0 - w1 - w3
    h0, h3 = gy * gy * gy * F(1 / 6), fy * fy * fy * F(1 / 6)
    h1 = (F(4) - F(6) * fy * fy + F(3) * fy * fy * fy) * F(1 / 6)
    h2 = F(1) - h0 - h1 - h3
    a0 = a1 = a2 = a3 = F(0)
    # without a sign an index needs no look at what is before the start
    first, second, third, fourth = U(x - 1), U(x), U(x + 1), U(x + 2)
    for row in range(4):
        d = U(y + row - 1)
        h = h0 if row == 0 else h1 if row == 1 else h2 if row == 2 else h3
        a0 += h if depths[d, first] >= z else F(0)
        a1 += h if depths[d, second] >= z else F(0)
        a2 += h if depths[d, third] >= z else F(0)
        a3 += h if depths[d, fourth] >= z else F(0)
    return a0 * w0 + a1 * w1 + a2 * w2 + a3 * w3


@kernel
def _lit(s: Floats32, n: int, lamps: Lamps) -> None:
    """Radiance of bodies, into DR, DG and DB."""
    room, points = lamps.room, lamps.points
    ar, ag, ab = room[0, 0], room[0, 1], room[0, 2]
    sx, sy, sz = room[1, 0], room[1, 1], room[1, 2]
    tr, tg, tb = room[3, 0], room[3, 1], room[3, 2]
    for k in range(n):
        x, y, z, nv, opened = s[NX + k], s[NY + k], s[NZ + k], s[NV + k], s[OPEN + k]
        a = s[ROUGH + k]
        wide = a + F(0.07)
        bulge = wide * wide - F(1)
        s[BULGE + k], s[WIDE + k] = bulge, F(2) * wide * wide / (F(2) * wide + F(1))
        over = F(0.25) / (F(0.25) + max(s[WZ + k] - GROUND, F(0)))
        inward = F(0.60) + F(0.26) * z + F(0.20) * (x * sx + y * sy + z * sz)
        below = over * (F(0.5) - F(0.5) * z) * F(0.8)
        cosine = s[COSINE + k]
        light = cosine * s[ARRIVES + k]
        lv = sx * s[VX + k] + sy * s[VY + k] + sz * s[VZ + k]
        shine = light * highlight(cosine, nv, lv, bulge, s[WIDE + k])
        s[DR + k] = (ar * inward + tr * below) * opened + room[2, 0] * light
        s[DG + k] = (ag * inward + tg * below) * opened + room[2, 1] * light
        s[DB + k] = (ab * inward + tb * below) * opened + room[2, 2] * light
        s[MR + k], s[MG + k], s[MB + k] = room[2, 0] * shine, room[2, 1] * shine, room[2, 2] * shine
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        red, green, blue = points[i, 3], points[i, 4], points[i, 5]
        for k in range(n):
            x, y, z = px - s[WX + k], py - s[WY + k], pz - s[WZ + k]
            inverse = F(1) / np.sqrt(x * x + y * y + z * z)
            x, y, z = x * inverse, y * inverse, z * inverse
            cosine = max(s[NX + k] * x + s[NY + k] * y + s[NZ + k] * z, F(0))
            light = cosine * inverse * inverse * (F(0.4) + F(0.6) * s[OPEN + k])
            lv = x * s[VX + k] + y * s[VY + k] + z * s[VZ + k]
            shine = light * highlight(cosine, s[NV + k], lv, s[BULGE + k], s[WIDE + k])
            s[DR + k] += red * light
            s[DG + k] += green * light
            s[DB + k] += blue * light
            s[MR + k] += red * shine
            s[MG + k] += green * shine
            s[MB + k] += blue * shine
    for k in range(n):
        a, nv, metal = s[ROUGH + k], s[NV + k], s[METAL + k]
        rx = F(2) * nv * s[NX + k] - s[VX + k]
        ry = F(2) * nv * s[NY + k] - s[VY + k]
        rz = F(2) * nv * s[NZ + k] - s[VZ + k]
        above = clamped(rz / (F(0.16) + F(2) * a) + F(0.5))
        toward = rx * F(1.4) * sx + ry * F(1.4) * sy + rz * F(0.6) * sz
        pane = clamped((toward - F(0.80)) / (F(0.06) + a) + F(0.5))
        sky = F(0.30) + F(0.80) * clamped(rz) + pane * (F(2.2) - F(1.8) * a)
        under = (F(1) + F(0.5) * min(rz, F(0))) * (F(1) - above)
        grazing = (F(1) - nv) * (F(1) - nv)
        grazing = (F(1) - a) * (F(1) - a) * F(0.2) * grazing * grazing
        opened = s[OPEN + k]
        sky *= above
        matt, base = F(1) - metal, F(0.04) * (F(1) - metal)
        red, green, blue = s[RED + k], s[GREEN + k], s[BLUE + k]
        f = base + red * metal
        r = red * matt * s[DR + k] + f * s[MR + k]
        s[DR + k] = r + (f + grazing * (F(1) - f)) * ((ar * sky + tr * under) * opened)
        f = base + green * metal
        r = green * matt * s[DG + k] + f * s[MG + k]
        s[DG + k] = r + (f + grazing * (F(1) - f)) * ((ag * sky + tg * under) * opened)
        f = base + blue * metal
        r = blue * matt * s[DB + k] + f * s[MB + k]
        s[DB + k] = r + (f + grazing * (F(1) - f)) * ((ab * sky + tb * under) * opened)


@kernel
def shade_bodies(
    pixels: Ids,
    frame: Frame,
    camera: tuple[Floats32, Lens],
    geometry: Geometry,
    light: tuple[Lamps, Sunlight],
    out: Canvas,
) -> None:
    """Colours of pixels that show bodies, into `out`."""
    lamps, sunlight = light
    s = np.empty(ROWS, np.float32)
    for start in range(0, len(pixels), GROUP):
        part = pixels[start : start + GROUP]
        n = len(part)
        _gather(s, part, frame, geometry)
        place_pixels(s, part, frame, camera)
        _surfaces(s, n, lamps, sunlight)
        if sunlight.drawn:
            for k in range(n):
                if s[COSINE + k] > F(0):
                    s[ARRIVES + k] *= _sun(s[SX + k], s[SY + k], s[SZ + k], sunlight)
        _lit(s, n, lamps)
        display(s, n)
        write(s, part, sunlight.masks.shape[0], out)

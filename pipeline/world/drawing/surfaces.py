"""Surfaces for our shaders: bodies with the room's light at each vertex, and the room's planes.
Planes fill most of an image: they are lit on a grid, shadows come from a mask, textures have one
level."""

import hashlib
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.cameras import CameraType
from pipeline.poses import Bools, Floats, Floats32, Ints, Pixels
from pipeline.world.shapes import Material, Mesh, Parts, merge, quads

from .compiled import compiled

CELLS = 44  # along the longest side of a body
CELL = (0.0015, 0.012)  # m, smallest and largest
REACH = 0.12  # m
RAYS = 40
LEAST = 0.3  # share of light that the deepest corner keeps: light that was scattered more than once

Grid = Bools
Points = Floats


@dataclass(frozen=True)
class _Body:
    """Parts equal by vertices, triangles and normals."""

    digest: bytes
    parts: Parts = field(compare=False)


def opened(parts: Parts) -> Parts:
    """Normals become as long as the share of the room's light, 0-1, that passes the body, by rays
    through filled cells."""
    if not parts:
        return parts
    content = hashlib.sha256()
    for mesh, _ in parts:
        for array in (mesh.vertices, mesh.triangles, mesh.normals):
            content.update(np.ascontiguousarray(array).tobytes())
    shares = _shares(_Body(content.digest(), parts))
    return [
        (replace(mesh, normals=mesh.normals * share[:, None]), material)
        for (mesh, material), share in zip(parts, shares, strict=True)
    ]


@lru_cache(maxsize=256)
def _shares(body: _Body) -> tuple[Floats32, ...]:
    """Light share (N,) of each mesh's vertices; cached because robots return every episode."""
    points = [mesh.vertices.astype(float) for mesh, _ in body.parts]
    every = np.concatenate(points)
    lower, extent = every.min(0), np.ptp(every, axis=0).max()
    cell = float(np.clip(extent / CELLS, *CELL))
    lower = lower - 2 * cell
    shape = np.ceil((every.max(0) - lower) / cell).astype(int) + 3
    grid = np.zeros(tuple(shape), np.bool_)
    for (mesh, _), vertices in zip(body.parts, points, strict=True):
        _fill(grid, vertices, mesh.triangles.astype(np.int64), lower, cell)
    rays, reach = sphere(RAYS), min(REACH, 0.7 * float(extent))
    return tuple(
        _open(grid, vertices, mesh.normals.astype(float), lower, cell, rays, reach)
        for (mesh, _), vertices in zip(body.parts, points, strict=True)
    )


def sphere(count: int) -> Points:
    """A Fibonacci lattice of directions (count,3)."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    turn = k * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)


@compiled
def _fill(grid: Grid, points: Points, triangles: Ints, lower: Points, cell: float) -> None:
    """Mark the cells that triangles pass through."""
    for a, b, c in triangles:
        u, v = points[b] - points[a], points[c] - points[a]
        longest = max(
            np.sqrt((u * u).sum()), np.sqrt((v * v).sum()), np.sqrt(((u - v) * (u - v)).sum())
        )
        n = int(longest / (0.6 * cell)) + 1
        for i in range(n + 1):
            for j in range(n + 1 - i):
                at = (points[a] + u * (i / n) + v * (j / n) - lower) / cell
                grid[int(at[0]), int(at[1]), int(at[2])] = True


@compiled
def _open(
    grid: Grid,
    points: Points,
    normals: Points,
    lower: Points,
    cell: float,
    rays: Points,
    reach: float,
) -> Floats32:
    """Share of light (N,) around each normal, weighted by cosine and nearness."""
    out = np.ones(len(points), np.float32)
    nx, ny, nz = grid.shape
    steps = int(reach / cell)
    for k in range(len(points)):
        normal = normals[k]
        sx, sy, sz = (points[k] + normal * (1.7 * cell) - lower) / cell
        whole, taken = 0.0, 0.0
        for r in range(len(rays)):
            dx, dy, dz = rays[r]
            cosine = dx * normal[0] + dy * normal[1] + dz * normal[2]
            if cosine < 0.08:
                continue
            whole += cosine
            for step in range(1, steps + 1):
                x, y = int(np.floor(sx + dx * step)), int(np.floor(sy + dy * step))
                z = int(np.floor(sz + dz * step))
                if x < 0 or y < 0 or z < 0 or x >= nx or y >= ny or z >= nz:
                    break
                if grid[x, y, z]:
                    taken += cosine * (1.0 - step * cell / (1.3 * reach))
                    break
        if whole > 0:
            out[k] = LEAST + (1.0 - LEAST) * (1.0 - taken / whole)
    return out


TABLE = "the table"
SHADOWED = (TABLE, "the floor")
"""Planes with shadows, by their names in `room`, in the order of the masks' channels."""

# m between the points of a grid: highlights on the table are sharper
TABLE_CELL, ROOM_CELL = 0.1, 0.7
# m, at which cameras see them: wrist cameras are nearer, the head camera is farther off
TABLE_DISTANCE, ROOM_DISTANCE = 0.6, 2.0
MAX_LEVEL = 3
RELIEF = 4.0  # texels between the deepest and the highest of a texture


def channel(name: str) -> int:
    """Shadow mask channel of a plane; planes without shadows take alpha, which is 1."""
    return SHADOWED.index(name) if name in SHADOWED else 3


def embossed(parts: Parts, direction: ArrayLike) -> Parts:
    """The relief of textures as lit from `direction`, darker being deeper. For surfaces that face
    up."""
    dx, dy, dz = np.asarray(direction, float)
    out = []
    for mesh, material in parts:
        if material.texture is not None and dz < 0:
            red, green, blue = np.moveaxis(material.texture[..., :3], -1, 0).astype(np.float32)
            height = (red + green + blue) / np.float32(3) / 255
            rise = [(np.roll(height, -1, axis) - np.roll(height, 1, axis)) / 2 for axis in (1, 0)]
            light = 1 + np.clip((rise[0] * dx + rise[1] * dy) / -dz * RELIEF, -0.2, 0.2)
            pixels = material.texture.copy()
            pixels[..., :3] = np.clip(np.rint(pixels[..., :3] * np.sqrt(light)[..., None]), 0, 255)
            material = replace(material, texture=pixels)
        out.append((mesh, material))
    return out


def prepared(name: str, parts: Parts, kind: CameraType) -> Parts:
    """A plane's parts as grids, with textures no finer than such a camera sees."""
    cell = TABLE_CELL if name == TABLE else ROOM_CELL
    return [
        (grid(mesh, cell), replace(material, texture=plane_texture(name, mesh, material, kind)))
        for mesh, material in parts
    ]


def plane_texture(name: str, mesh: Mesh, material: Material, kind: CameraType) -> Pixels | None:
    """A plane's texture, no finer than such a camera sees."""
    if (image := material.texture) is None:
        return None
    distance = TABLE_DISTANCE if name == TABLE else ROOM_DISTANCE
    pixel = distance * 2 * np.tan(np.radians(kind.fovy) / 2) / kind.height
    return halved(image, texture_level(mesh, image, pixel))


def grid(mesh: Mesh, cell: float) -> Mesh:
    """Rectangles (of `room.quad`) cut into cells of about `cell` (m), except a box's underside."""
    pieces = []
    for k in range(0, len(mesh.vertices), 4):
        a, b, _, d = mesh.vertices[k : k + 4].astype(np.float64)
        nu, nv = (max(1, round(float(np.linalg.norm(edge)) / cell)) for edge in (b - a, d - a))
        if mesh.normals[k, 2] < -0.5 and len(mesh.vertices) > 4:
            nu, nv = 1, 1
        v, u = np.meshgrid(np.arange(nv + 1) / nv, np.arange(nu + 1) / nu, indexing="ij")
        weights = np.stack([1 - u - v, u, v], -1).reshape(-1, 3)  # of a, b and d
        i = np.arange((nu + 1) * (nv + 1)).reshape(nv + 1, nu + 1)
        p, q, r, s = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
        uvs = None
        if mesh.uvs is not None:
            uvs = (weights @ mesh.uvs[[k, k + 1, k + 3]]).astype(np.float32)
        points = (weights @ np.stack([a, b, d])).astype(np.float32)
        normals = np.repeat(mesh.normals[k : k + 1], len(weights), 0)
        pieces.append(Mesh(points, quads(p, q, r, s).astype(np.uint32), normals, uvs))
    return merge(pieces)


def texture_level(mesh: Mesh, texture: Pixels, pixel: float) -> int:
    """How often to halve a texture so that a texel is about a `pixel` (m)."""
    if mesh.uvs is None:
        return 0
    a, b = mesh.triangles[0][:2]
    metres = np.linalg.norm(mesh.vertices[b] - mesh.vertices[a])
    texel = metres / (np.linalg.norm(mesh.uvs[b] - mesh.uvs[a]) * texture.shape[1])
    return int(np.clip(np.rint(np.log2(pixel / texel)), 0, MAX_LEVEL))


def halved(texture: Pixels, times: int) -> Pixels:
    """Average 2x2 texels, `times` or until a side is odd."""
    for _ in range(times):
        h, w = texture.shape[:2]
        if h % 2 or w % 2:
            break
        four = texture.astype(np.uint16)
        four = four[::2] + four[1::2]
        four = four[:, ::2] + four[:, 1::2]
        # the nearest whole number of a quarter, the even one of two; a mean takes ten times as long
        texture = ((four + 1 + ((four >> 2) & 1)) >> 2).astype(np.uint8)
    return texture

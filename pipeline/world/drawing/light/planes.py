"""The planes of the room, table top included, as our shaders want them.

They fill most of an image: light is computed at the points of a grid, shadows come from a mask, and
a texture has one level, chosen for the camera; mipmaps cost more per pixel than all light.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.cameras import CameraType
from pipeline.world.shapes import Mesh, Parts, merge, quads

TABLE = "the table"
SHADOWED = (TABLE, "the floor")
"""Planes that shadows fall on where a camera may see it, by their names in `room`, in the order of
the masks' channels."""

# m between the points of a grid: highlights on the table are sharper
TABLE_CELL, ROOM_CELL = 0.1, 0.7
# m, at which cameras see them: wrist cameras are nearer, the head camera is farther off
TABLE_DISTANCE, ROOM_DISTANCE = 0.6, 2.0
MAX_LEVEL = 3
RELIEF = 4.0  # texels between the deepest and the highest of a texture


def channel(name: str) -> int:
    """Channel of the shadow masks for a plane; planes without shadows take alpha, which is 1."""
    return SHADOWED.index(name) if name in SHADOWED else 3


def embossed(parts: Parts, direction: ArrayLike) -> Parts:
    """The parts with what light from one `direction` makes of the relief of their textures:
    darker is deeper. For surfaces that face up, their texture's columns along x and its rows
    along y."""
    dx, dy, dz = np.asarray(direction, float)
    out = []
    for mesh, material in parts:
        if material.texture is not None and dz < 0:
            height = material.texture[..., :3].astype(np.float32).mean(-1) / 255
            rise = [(np.roll(height, -1, axis) - np.roll(height, 1, axis)) / 2 for axis in (1, 0)]
            light = 1 + np.clip((rise[0] * dx + rise[1] * dy) / -dz * RELIEF, -0.2, 0.2)
            pixels = material.texture.copy()
            pixels[..., :3] = np.clip(np.rint(pixels[..., :3] * np.sqrt(light)[..., None]), 0, 255)
            material = replace(material, texture=pixels)
        out.append((mesh, material))
    return out


def prepared(name: str, parts: Parts, kind: CameraType) -> Parts:
    """The parts of a plane as grids, with textures no finer than a camera of this type sees."""
    cell, distance = (TABLE_CELL, TABLE_DISTANCE) if name == TABLE else (ROOM_CELL, ROOM_DISTANCE)
    pixel = distance * 2 * np.tan(np.radians(kind.fovy) / 2) / kind.height
    out = []
    for mesh, material in parts:
        if material.texture is not None:
            material = replace(
                material,
                texture=halved(material.texture, texture_level(mesh, material.texture, pixel)),
            )
        out.append((grid(mesh, cell), material))
    return out


def grid(mesh: Mesh, cell: float) -> Mesh:
    """The mesh with its rectangles (of `room.quad`) cut into grids of about `cell` (m), but for
    the underside of a box."""
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
        triangles = quads(p, q, r, s)
        uvs = (
            None if mesh.uvs is None else (weights @ mesh.uvs[[k, k + 1, k + 3]]).astype(np.float32)
        )
        normals = np.repeat(mesh.normals[k : k + 1], len(weights), 0)
        pieces.append(
            Mesh(
                (weights @ np.stack([a, b, d])).astype(np.float32),
                triangles.astype(np.uint32),
                normals,
                uvs,
            )
        )
    return merge(pieces)


def texture_level(mesh: Mesh, texture: NDArray[np.uint8], pixel: float) -> int:
    """How often to halve a texture (H,W,4) so that a texel is about as large as a `pixel` (m), 0
    to MAX_LEVEL."""
    if mesh.uvs is None:
        return 0
    a, b = mesh.triangles[0][:2]
    metres = np.linalg.norm(mesh.vertices[b] - mesh.vertices[a])
    texel = metres / (np.linalg.norm(mesh.uvs[b] - mesh.uvs[a]) * texture.shape[1])
    return int(np.clip(np.rint(np.log2(pixel / texel)), 0, MAX_LEVEL))


def halved(texture: NDArray[np.uint8], times: int) -> NDArray[np.uint8]:
    """The texture (H,W,4) with blocks of 2x2 texels averaged, so many times or until a side is
    odd."""
    for _ in range(times):
        h, w = texture.shape[:2]
        if h % 2 or w % 2:
            break
        texture = np.rint(texture.reshape(h // 2, 2, w // 2, 2, -1).mean((1, 3))).astype(np.uint8)
    return texture

"""Merge the parts of a body into few draw calls, shadow casters and bounds, in a fixed order.

A draw call costs the software rasteriser about 20 us whatever it draws.
"""

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.world.shapes import Material, Mesh, Parts, merge

PLAIN = -(1 << 20)
"""uvs with v at or below this hold a material and are no texture coordinates;
`shaders/common/vertex.glsl` has the same number."""


def by_material(parts: Parts) -> list[tuple[Mesh, Material]]:
    """The parts with those of equal material merged, in the order of first appearance."""
    groups: dict[tuple[Any, ...], list[tuple[Mesh, Material]]] = {}
    for mesh, material in parts:
        key = (
            tuple(material.color),
            material.roughness,
            material.metallic,
            _content(material),
            mesh.uvs is None,
        )
        groups.setdefault(key, []).append((mesh, material))
    return [
        (merge([mesh for mesh, _ in group]) if len(group) > 1 else group[0][0], group[0][1])
        for group in groups.values()
    ]


def packed(parts: Parts) -> list[tuple[Mesh, Material]]:
    """The parts as one mesh per texture, at least one: untextured parts carry their material in
    their uvs (`material_uv`) and join the first mesh, whose material holds for its textured
    vertices only."""
    groups: dict[tuple[Any, ...], list[tuple[Mesh, Material]]] = {}
    plain: list[Mesh] = []
    for mesh, material in parts:
        if material.texture is None or mesh.uvs is None:
            plain.append(replace(mesh, uvs=np.tile(material_uv(material), (len(mesh.vertices), 1))))
        else:
            groups.setdefault(
                (material.roughness, material.metallic, _content(material)), []
            ).append((mesh, material))
    if not groups:
        return [(merge(plain), Material((1.0, 1.0, 1.0)))] if plain else []
    textured = [([mesh for mesh, _ in group], group[0][1]) for group in groups.values()]
    return [
        (merge([*(plain if i == 0 else []), *meshes]), material)
        for i, (meshes, material) in enumerate(textured)
    ]


def material_uv(material: Material) -> NDArray[np.float32]:
    """A material as a uv pair (2,): u = colour as 0xRRGGBB, v = PLAIN - (roughness * 256 +
    metallic), 8 bits each."""
    r, g, b, roughness, metallic = np.rint(
        np.clip([*material.color, material.roughness, material.metallic], 0, 1) * 255
    )
    return np.array([r * 65536 + g * 256 + b, PLAIN - (roughness * 256 + metallic)], np.float32)


def caster(parts: Parts, cell: float) -> Mesh:
    """The shape of the parts for the shadow map: vertices in one cube of `cell` (m) become their
    mean, and triangles without area are dropped. Normals and uvs are zero."""
    whole = merge([mesh for mesh, _ in parts])
    vertices = whole.vertices.astype(np.float64)
    cubes = np.floor(vertices / cell).astype(np.int64) + (1 << 20)
    keys = (cubes[:, 0] << 42) | (cubes[:, 1] << 21) | cubes[:, 2]
    _, index, count = np.unique(keys, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(index, vertices[:, k]) for k in range(3)], 1) / count[:, None]
    triangles = index[whole.triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)].astype(np.uint32)
    means = means.astype(np.float32)
    return Mesh(means, triangles, np.zeros_like(means), np.zeros((len(means), 2), np.float32))


def bounds(parts: Parts) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middle and half size (3,), m, of the axis-aligned box of the parts in the body frame."""
    points = np.concatenate([mesh.vertices for mesh, _ in parts]).astype(np.float64)
    lower, upper = points.min(0), points.max(0)
    return (lower + upper) / 2, (upper - lower) / 2


def _content(material: Material) -> bytes:
    if material.texture is None:
        return b""
    return hashlib.blake2b(np.ascontiguousarray(material.texture), digest_size=16).digest()

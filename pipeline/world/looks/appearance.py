"""Parts of bodies kept in an asset store and loaded from it, textures as their sources."""

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.assets import AssetError, AssetStore
from pipeline.world.looks.materials import texture_pixels
from pipeline.world.shapes import Material, Mesh, Parts, TextureSource

_ARRAYS = ("vertices", "triangles", "normals")


def store_parts(store: AssetStore, parts: Parts) -> str:
    """Keep the parts of a body; returns the hash to find them by. A texture without a source is
    kept as pixels."""
    arrays: dict[str, NDArray[Any]] = {}
    described = []
    for i, (mesh, material) in enumerate(parts):
        arrays |= {f"{i}.{name}": getattr(mesh, name) for name in _ARRAYS}
        if mesh.uvs is not None:
            arrays[f"{i}.uvs"] = mesh.uvs
        texture: dict[str, Any] | None = None
        if material.texture is not None and material.source is not None:
            source = material.source
            texture = {
                "kind": source.kind,
                "arguments": _plain(source.arguments),
                "sha256": _pixel_hash(material.texture),
            }
        elif material.texture is not None:
            arrays[f"{i}.texture"], texture = material.texture, {"kind": "pixels"}
        described.append(
            {
                "color": [float(c) for c in material.color],
                "roughness": float(material.roughness),
                "metallic": float(material.metallic),
                "texture": texture,
            }
        )
    return store.put(arrays, described)


def load_parts(store: AssetStore, key: str) -> Parts:
    """The parts that `store_parts` kept. Raises AssetError where they are missing or damaged, or
    where this version makes another image from a texture's source."""
    arrays, described = store.get(key)
    parts = []
    for i, values in enumerate(described):
        mesh = Mesh(*(arrays[f"{i}.{name}"] for name in _ARRAYS), uvs=arrays.get(f"{i}.uvs"))
        r, g, b = values["color"]
        pixels, source = _texture(store, key, values["texture"], arrays.get(f"{i}.texture"))
        parts.append(
            (mesh, Material((r, g, b), values["roughness"], values["metallic"], pixels, source))
        )
    return tuple(parts)


def _texture(
    store: AssetStore, key: str, texture: dict[str, Any] | None, pixels: NDArray[np.uint8] | None
) -> tuple[NDArray[np.uint8] | None, TextureSource | None]:
    if texture is None or texture["kind"] == "pixels":
        return pixels, None
    source = TextureSource(texture["kind"], _tuples(texture["arguments"]))
    made = texture_pixels(source)
    if _pixel_hash(made) != texture["sha256"]:
        raise AssetError(
            f"{store.path(key)}: this version draws its {source.kind} texture differently; use the"
            " one that made it"
        )
    return made, source


def _pixel_hash(pixels: NDArray[np.uint8]) -> str:
    return hashlib.sha256(np.ascontiguousarray(pixels)).hexdigest()[:32]


def _plain(arguments: Any) -> Any:
    return [_plain(a) for a in arguments] if isinstance(arguments, tuple) else arguments


def _tuples(arguments: Any) -> Any:
    return tuple(_tuples(a) for a in arguments) if isinstance(arguments, list) else arguments

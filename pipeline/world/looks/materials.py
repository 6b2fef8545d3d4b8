"""Materials by everyday name, `glaze("teal")`, `metal()`, `wood("walnut", seed=3)`, their textures,
and stored parts.

A colour is a name of `PALETTE` or an sRGB triple 0-1. Textures need a mesh with uvs in the unit
square; their arrays are shared and read-only."""

import hashlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from pipeline.data.slots.assets import AssetError, AssetStore
from pipeline.poses import Pixels
from pipeline.world.shapes import Material, Mesh, Parts, TextureSource

from .prints import PRINTS, Triple, handled, printing
from .skins import skin
from .tabletops import TABLETOPS
from .textures import BASIC, Rgba
from .walls import DISTANT, WALLS

PATTERNS = BASIC | TABLETOPS | WALLS | DISTANT
SIZES = dict.fromkeys(TABLETOPS, 512) | dict.fromkeys(WALLS, 512)
"""Texels a side of what is drawn finer than the usual 256."""


def texture(pattern: str, seed: int, colour: ArrayLike, size: int | None = None) -> Rgba:
    """Texture (size,size,4). Raises KeyError for an unknown pattern."""
    if pattern not in PATTERNS:
        known = ", ".join(PATTERNS)
        raise KeyError(f"texture pattern {pattern!r} is unknown: patterns are {known}")
    rng = Generator(np.random.Philox(seed))
    return PATTERNS[pattern](rng, size or SIZES.get(pattern, 256), colour)


Color = str | Triple

PALETTE: dict[str, tuple[float, float, float]] = {
    "red": (0.72, 0.16, 0.14),
    "green": (0.20, 0.50, 0.25),
    "blue": (0.16, 0.30, 0.64),
    "yellow": (0.90, 0.74, 0.22),
    "cyan": (0.22, 0.68, 0.76),
    "magenta": (0.70, 0.20, 0.52),
    "black": (0.07, 0.07, 0.08),
    "gray": (0.50, 0.50, 0.51),
    "orange": (0.88, 0.48, 0.16),
    "purple": (0.44, 0.25, 0.56),
    "brown": (0.41, 0.27, 0.18),
    "pink": (0.89, 0.63, 0.70),
    "lime": (0.58, 0.75, 0.27),
    "olive": (0.46, 0.46, 0.20),
    "teal": (0.12, 0.45, 0.45),
    "maroon": (0.42, 0.11, 0.16),
    "navy": (0.11, 0.16, 0.33),
    "coral": (0.88, 0.49, 0.42),
    "turquoise": (0.32, 0.73, 0.68),
    "indigo": (0.28, 0.20, 0.50),
    "beige": (0.90, 0.84, 0.71),
    "tan": (0.79, 0.65, 0.46),
    "silver": (0.74, 0.75, 0.77),
    "white": (0.93, 0.93, 0.92),
    "cream": (0.95, 0.91, 0.80),
    "gold": (0.79, 0.63, 0.30),
    "charcoal": (0.20, 0.21, 0.23),
    "mint": (0.67, 0.83, 0.74),
    "lavender": (0.71, 0.65, 0.86),
    "sky blue": (0.53, 0.72, 0.87),
    "dark green": (0.09, 0.30, 0.18),
    "rust": (0.60, 0.31, 0.18),
}
"""sRGB of every colour word that descriptions use."""

WOODS: dict[str, tuple[float, float, float]] = {
    "oak": (0.76, 0.58, 0.38),
    "pine": (0.86, 0.71, 0.49),
    "walnut": (0.42, 0.28, 0.18),
    "beech": (0.82, 0.64, 0.46),
    "mahogany": (0.50, 0.24, 0.15),
    "birch": (0.90, 0.80, 0.63),
}


def srgb(color: Color) -> tuple[float, float, float]:
    """The sRGB triple. Raises KeyError for an unknown name."""
    if not isinstance(color, str):
        r, g, b = color
        return float(r), float(g), float(b)
    triple = PALETTE.get(color) or WOODS.get(color)
    if triple is None:
        raise KeyError(f"colour {color!r} is unknown: colours are {', '.join([*PALETTE, *WOODS])}")
    return triple


def shaded(color: Color, factor: float) -> Triple:
    """The sRGB triple times a factor, at most 1."""
    r, g, b = (min(1.0, factor * channel) for channel in srgb(color))
    return r, g, b


def glaze(color: Color) -> Material:
    return Material(srgb(color), roughness=0.22)


def plastic(color: Color) -> Material:
    return Material(srgb(color), roughness=0.42)


def painted(color: Color) -> Material:
    return Material(srgb(color), roughness=0.5)


def rubber(color: Color = "charcoal") -> Material:
    return Material(srgb(color), roughness=0.9)


def metal(color: Color = "silver", seed: int | None = None) -> Material:
    return _textured("brushed", color, seed, roughness=0.35, metallic=0.85)


def wood(tone: Color = "oak", seed: int | None = None) -> Material:
    """Wood of a tone of `WOODS` or any colour; with a seed grained along u."""
    return _textured("veneer", tone, seed, roughness=0.55)


def fabric(color: Color, seed: int | None = None) -> Material:
    return _textured("fabric", color, seed, roughness=0.95)


def wrapped(
    kind: str, color: Color, seed: int, roughness: float, size: int = 128, metallic: float = 0.0
) -> Material:
    """A skin of `skins.SKINS`, for uvs that fit it."""
    source = TextureSource("skin", (kind, seed, srgb(color), size))
    return Material(srgb(color), roughness, metallic, texture_pixels(source), source)


def worn(color: Color, seed: int, roughness: float = 0.45) -> Material:
    """Worn paint or plastic, for meshes whose sides each cover the uv square."""
    return printed(print_texture(color, "cream", "worn", seed=seed), roughness)


def printed(source: TextureSource, roughness: float = 0.45) -> Material:
    image = texture_pixels(source)
    r, g, b = (image[..., :3].reshape(-1, 3).mean(0) / 255.0).tolist()
    return Material((r, g, b), roughness=roughness, texture=image, source=source)


def print_texture(
    base: Color, accent: Color, kind: str = "label", text: str = "", seed: int = 0, size: int = 128
) -> TextureSource:
    """Printed packaging of a kind of `prints.PRINTS`. Raises KeyError for an unknown kind or
    colour."""
    if kind not in PRINTS:
        raise KeyError(f"print {kind!r} is unknown: prints are {', '.join(PRINTS)}")
    return TextureSource("packaging", (srgb(base), srgb(accent), kind, text, seed, size))


def made_of(material: str, color: Color, seed: int | None = None) -> Material:
    if material == "wood":
        return wood(color, seed)
    skins = {"painted": painted, "plastic": plastic, "rubber": rubber, "ceramic": glaze}
    return metal(color) if material == "metal" else skins[material](color)


def _textured(
    pattern: str, color: Color, seed: int | None, roughness: float, metallic: float = 0.0
) -> Material:
    if seed is None:
        return Material(srgb(color), roughness, metallic)
    source = TextureSource("tile", (pattern, seed, srgb(color), 128))
    return Material(srgb(color), roughness, metallic, texture_pixels(source), source)


@lru_cache(maxsize=16)
def texture_pixels(source: TextureSource) -> Rgba:
    """The image (H,W,4) uint8 sRGB, read-only; row 0 is v = 0. Raises KeyError."""
    if source.kind not in TEXTURES:
        raise KeyError(f"texture kind {source.kind!r} is unknown: kinds are {', '.join(TEXTURES)}")
    image = TEXTURES[source.kind](*source.arguments)
    image.setflags(write=False)
    return image


TEXTURES: dict[str, Callable[..., Rgba]]
TEXTURES = {"tile": texture, "print": printing, "packaging": handled, "skin": skin}
"""Functions that make textures, by kind; a `TextureSource` has their arguments in order."""

_ARRAYS = ("vertices", "triangles", "normals")


def store_parts(store: AssetStore, parts: Parts) -> str:
    """Store parts; returns their hash. Only textures without a source are kept as pixels."""
    arrays: dict[str, NDArray[Any]] = {}
    described = []
    for i, (mesh, material) in enumerate(parts):
        arrays |= {f"{i}.{name}": getattr(mesh, name) for name in _ARRAYS}
        if mesh.uvs is not None:
            arrays[f"{i}.uvs"] = mesh.uvs
        texture: dict[str, Any] | None = None
        if material.texture is not None and (source := material.source) is not None:
            texture = {"kind": source.kind, "arguments": _plain(source.arguments)}
            texture["sha256"] = _pixel_hash(material.texture)
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
    """Load stored parts. Raises AssetError if missing, damaged, or if a source now makes another
    image."""
    arrays, described = store.get(key)
    parts = []
    for i, values in enumerate(described):
        mesh = Mesh(*(arrays[f"{i}.{name}"] for name in _ARRAYS), uvs=arrays.get(f"{i}.uvs"))
        r, g, b = values["color"]
        look = _texture(store, key, values["texture"], arrays.get(f"{i}.texture"))
        material = Material((r, g, b), values["roughness"], values["metallic"], *look)
        parts.append((mesh, material))
    return tuple(parts)


def _texture(
    store: AssetStore, key: str, texture: dict[str, Any] | None, pixels: Pixels | None
) -> tuple[Pixels | None, TextureSource | None]:
    if texture is None or texture["kind"] == "pixels":
        return pixels, None
    source = TextureSource(texture["kind"], _tuples(texture["arguments"]))
    made = texture_pixels(source)
    if _pixel_hash(made) != texture["sha256"]:
        wrong = (
            f"this version draws its {source.kind} texture differently; use the one that made it"
        )
        raise AssetError(f"{store.path(key)}: {wrong}")
    return made, source


def _pixel_hash(pixels: Pixels) -> str:
    return hashlib.sha256(np.ascontiguousarray(pixels)).hexdigest()[:32]


def _plain(arguments: Any) -> Any:
    return [_plain(a) for a in arguments] if isinstance(arguments, tuple) else arguments


def _tuples(arguments: Any) -> Any:
    return tuple(_tuples(a) for a in arguments) if isinstance(arguments, list) else arguments

"""The look of room and lights: drawn per attempt from its own stream, or from a user's images."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from pipeline.data.episode.visuals import LOOK, PointLight, Surface, Triple, Visuals
from pipeline.poses import Floats, Floats32

from .tabletops import TABLETOPS
from .textures import Rgba
from .walls import DISTANT, SPAN, WALLS

CLEAN = Visuals(
    table=Surface("staves", 12, (0.78, 0.68, 0.55), 0.60),
    wall=Surface("workshop", 4, (0.84, 0.84, 0.82), SPAN),
    ground=Surface("concrete", 2, (0.56, 0.55, 0.54), 1.5),
    ambient=(0.29, 0.30, 0.32),
    sun_direction=(0.40, -0.55, -1.0),
    sun=(0.72, 0.69, 0.63),
    points=(
        PointLight((0.9, -0.5, 1.8), (0.24, 0.23, 0.21)),
        PointLight((-0.9, -0.5, 1.8), (0.24, 0.23, 0.21)),
    ),
    look=LOOK,
)
"""The clean domain: pale wooden table, a workshop's wall, light from behind the table on the
left, towards the robot, so that no robot throws a shadow on the table."""

TABLE_PATTERNS = (*TABLETOPS, "staves", "veneer", "linen", "laminate", "felt", "marble")
WALL_PATTERNS = (*WALLS, *WALLS, *DISTANT)
GROUND_PATTERNS = ("planks", "tiles", "concrete", "veneer", "fine terrazzo")
PLAIN_RATE = 0.02  # chance, per surface, of the clean look inside the randomised domain
TIMBER = (
    *((0.78, 0.66, 0.50), (0.66, 0.50, 0.34), (0.45, 0.32, 0.22), (0.58, 0.40, 0.28)),
    (0.80, 0.72, 0.60),
)
MINERAL = (
    *((0.86, 0.84, 0.80), (0.45, 0.46, 0.48), (0.62, 0.60, 0.57), (0.28, 0.29, 0.31)),
    *((0.72, 0.66, 0.58), (0.88, 0.88, 0.87)),
)
PAINTS = (
    *((0.86, 0.85, 0.82), (0.74, 0.76, 0.76), (0.80, 0.76, 0.68), (0.62, 0.67, 0.66)),
    *((0.60, 0.64, 0.70), (0.90, 0.89, 0.87)),
)
FREE, FREE_TIMBER = 0.22, 0.10  # largest share of any other colour in these


def draw_visuals(rng: Generator, split: str = "seen") -> Visuals:
    """Randomized looks. Texture seeds are even in the "seen" split and odd in "unseen"."""
    table = _surface(rng, TABLE_PATTERNS, MINERAL, (0.45, 0.7), split, CLEAN.table)
    wall = _surface(rng, WALL_PATTERNS, PAINTS, (0.5, 0.9), split, CLEAN.wall)
    ground = _surface(rng, GROUND_PATTERNS, MINERAL, (0.8, 1.5), split, CLEAN.ground)
    ambient = _light(rng, 0.16, 0.30, 0.93)
    sun = _light(rng, 0.45, 0.85, 0.86)
    direction = (float(rng.uniform(-0.6, 0.6)), float(rng.uniform(-0.75, -0.3)), -1.0)
    points = tuple(PointLight(p.position, _light(rng, 0.08, 0.26, 0.82)) for p in CLEAN.points)
    return Visuals(table, wall, ground, ambient, direction, sun, points, LOOK)


def _surface(
    rng: Generator,
    patterns: Sequence[str],
    paints: Sequence[Triple],
    tile: tuple[float, float],
    split: str,
    clean: Surface,
) -> Surface:
    """One surface: wood takes a timber's colour, the rest `paints`."""
    plain = rng.random() < PLAIN_RATE
    pattern = patterns[int(rng.integers(len(patterns)))]
    seed = 2 * int(rng.integers(1 << 30)) + (split == "unseen")
    kinds = TIMBER if pattern in ("staves", "veneer", "planks") else paints
    own, free = np.array(kinds[int(rng.integers(len(kinds)))]), rng.uniform(0.12, 0.92, 3)
    mixing = (FREE_TIMBER if kinds is TIMBER else FREE) * rng.random()
    r, g, b = own + (free - own) * mixing
    size = SPAN if pattern in WALLS else float(rng.uniform(*tile))
    return clean if plain else Surface(pattern, seed, (float(r), float(g), float(b)), size)


def _light(rng: Generator, low: float, high: float, whiteness: float) -> Triple:
    """A light between `low` and `high`; its weakest channel keeps the share `whiteness`."""
    r, g, b = rng.uniform(low, high) * (whiteness + (1.0 - whiteness) * rng.random(3))
    return float(r), float(g), float(b)


IMAGE = "image"
"""The pattern of a surface whose texture is an image; its seed is the image's number."""

# of the sphere: the brightest part of the upper half, which becomes the directional light
SUN_SHARE = 0.01
LOWEST_SUN = 0.35  # of the direction to it, upwards
BRIGHTNESS = 0.95  # irradiance over pi that the table gets, as in the clean room


def with_textures(
    visuals: Visuals, textures: Mapping[str, Sequence[tuple[Rgba, float]]], rng: Generator
) -> Visuals:
    """An image, drawn from `rng`, on each surface whose kind has images."""
    changed = dict[str, Surface]()
    for kind, surface in (("table", "table"), ("wall", "wall"), ("floor", "ground")):
        if images := textures.get(kind):
            number = int(rng.integers(len(images)))
            pixels, metres = images[number]
            r, g, b = pixels[..., :3].reshape(-1, 3).mean(0) / 255
            changed[surface] = Surface(IMAGE, number, (float(r), float(g), float(b)), metres)
    return replace(visuals, **changed)


def lit_by(visuals: Visuals, radiance: Floats32) -> Visuals:
    """Light from an equirectangular image (H,W,3), its middle away from the robot: its brightest
    hundredth above the table is directional, the rest ambient, as bright as in the clean room."""
    toward, solid = _directions(*radiance.shape[:2])
    light = radiance.astype(np.float64) * solid[..., None]
    above = np.maximum(toward[..., 2], 0)
    bright = np.where(toward[..., 2] > LOWEST_SUN, radiance.astype(np.float64).sum(-1), -1.0)
    order = np.argsort(-bright.ravel(), kind="stable")
    count = (np.cumsum(solid.ravel()[order]) < SUN_SHARE * 4 * np.pi).sum()
    brightest = order[: max(1, int(count))]
    flat, ways = light.reshape(-1, 3), toward.reshape(-1, 3)
    way = (flat[brightest].sum(1, keepdims=True) * ways[brightest]).sum(0)
    way /= np.linalg.norm(way)
    sun = flat[brightest].sum(0) / np.pi
    ambient = (flat * above.reshape(-1, 1)).sum(0) / np.pi - sun * way[2]
    ambient = np.maximum(ambient, 0)
    scale = BRIGHTNESS / (ambient + sun * way[2]).mean()
    x, y, z = (-way).round(6).tolist()
    lights = {"ambient": _color(ambient * scale), "sun": _color(sun * scale)}
    return replace(visuals, **lights, sun_direction=(x, y, z), points=())


def _directions(height: int, width: int) -> tuple[Floats, Floats]:
    """World directions (H,W,3) of equirectangular pixels, and solid angles (H,W)."""
    polar = (np.arange(height) + 0.5) / height * np.pi
    around = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None]
    way = np.stack(np.broadcast_arrays(sine * np.sin(around), sine * np.cos(around), cosine), -1)
    return way, np.broadcast_to(sine * (np.pi / height) * (2 * np.pi / width), (height, width))


def _color(light: Floats) -> Triple:
    """Rounded, so that images ignore a sum's last bit."""
    r, g, b = light.round(6).tolist()
    return r, g, b

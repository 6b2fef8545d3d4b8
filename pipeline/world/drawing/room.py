"""Table, floor, walls and ceiling as meshes in the world frame."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.episode.visuals import FIRST_LOOK, Surface, Visuals
from pipeline.world.looks.materials import texture
from pipeline.world.looks.textures import Rgba
from pipeline.world.looks.visuals import IMAGE
from pipeline.world.physics.body import TABLE_HALF, TABLE_THICKNESS, TABLE_TOP
from pipeline.world.shapes import Material, Mesh, merge

LEG_WIDTH = 0.05
TABLE_ROUGHNESS = 0.45
# roughness of table tops without sheen, from the second look on
MATT: dict[str, float] = dict.fromkeys(("linen", "gingham", "felt", "concrete"), 0.95)
WALL_Y = 1.0
ROOM = ((-3.0, -3.0, 0.0), (3.0, WALL_Y, 3.0))  # lower and upper corner, m


def quad(corner: ArrayLike, u: ArrayLike, v: ArrayLike, tile: float) -> Mesh:
    """Rectangle from a corner and two edge vectors (3,) m, normal u x v, a texture tile every
    `tile` m."""
    corner, u, v = (np.asarray(a, float) for a in (corner, u, v))
    n = np.cross(u, v)
    n = n / np.linalg.norm(n)
    size = np.array([np.linalg.norm(u), np.linalg.norm(v)]) / tile
    return Mesh(
        np.array([corner, corner + u, corner + u + v, corner + v], np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
        np.tile(n, (4, 1)).astype(np.float32),
        (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size).astype(np.float32),
    )


def box(centre: ArrayLike, half: ArrayLike, tile: float = 1.0) -> Mesh:
    """Axis-aligned box; half extents (3,) m, uvs in metres / `tile`."""
    x, y, z = np.asarray(half, float)[:, None] * np.eye(3)
    c = np.asarray(centre, float)
    return merge(
        [
            quad(c + s * n - s * 2 * u / 2 - 2 * v / 2, s * 2 * u, 2 * v, tile)
            for n, u, v in ((x, y, z), (y, z, x), (z, x, y))
            for s in (1, -1)
        ]
    )


def surface_material(surface: Surface, roughness: float, image: Rgba | None = None) -> Material:
    if surface.pattern == IMAGE:
        return Material(surface.color, roughness, 0.0, image)
    return _drawn(surface, roughness)


@lru_cache(maxsize=8)
def _drawn(surface: Surface, roughness: float) -> Material:
    """Cached: drawing a texture takes 5 ms."""
    pixels = texture(surface.pattern, surface.seed, surface.color)
    pixels.flags.writeable = False
    return Material(surface.color, roughness, 0.0, pixels)


def table_top(
    visuals: Visuals, images: Mapping[str, Rgba] | None = None
) -> list[tuple[Mesh, Material]]:
    """Table top; `images` (H,W,4) by kind are the textures that are not drawn."""
    matt = {} if visuals.look == FIRST_LOOK else MATT
    roughness = matt.get(visuals.table.pattern, TABLE_ROUGHNESS)
    half = (*TABLE_HALF, TABLE_THICKNESS / 2)
    top = box((0, 0, TABLE_TOP - TABLE_THICKNESS / 2), half, visuals.table.tile)
    return [(top, surface_material(visuals.table, roughness, (images or {}).get("table")))]


def table_legs() -> list[tuple[Mesh, Material]]:
    half = (LEG_WIDTH / 2, LEG_WIDTH / 2, (TABLE_TOP - TABLE_THICKNESS) / 2)
    x, y = (extent - (0.05 + LEG_WIDTH / 2) for extent in TABLE_HALF)
    legs = [box((sx * x, sy * y, half[2]), half) for sx in (-1, 1) for sy in (-1, 1)]
    return [(merge(legs), Material((0.34, 0.34, 0.36), 0.5))]


def table_light(visuals: Visuals, texture: Rgba | None) -> tuple[float, float, float]:
    """Light that a table scatters: its mean linear colour times its light."""
    assert texture is not None
    albedo = ((texture[::4, ::4, :3] / 255.0) ** 2).mean((0, 1))
    light = np.array(visuals.ambient)
    direction = np.asarray(visuals.sun_direction, float)
    light = light + np.array(visuals.sun) * max(-direction[2] / np.linalg.norm(direction), 0.0)
    for point in visuals.points:
        to = np.array(point.position) - (0.0, 0.0, TABLE_TOP)
        light = light + np.array(point.color) * max(to[2], 0.0) / np.linalg.norm(to) ** 3
    red, green, blue = (albedo * light).tolist()
    return red, green, blue


def shell(
    visuals: Visuals, closed: bool = True, images: Mapping[str, Rgba] | None = None
) -> dict[str, list[tuple[Mesh, Material]]]:
    """Floor and back wall, if `closed` the other walls and ceiling, by name. The first look
    textures only the back wall; ray tracing needs the room open for its light."""
    (x0, y0, z0), (x1, y1, z1) = ROOM
    w, d, h = x1 - x0, y1 - y0, z1 - z0
    images = images or {}
    plain = Material(visuals.wall.color, 0.9)
    back = surface_material(visuals.wall, 0.85, images.get("wall"))
    ground = surface_material(visuals.ground, 0.7, images.get("floor"))
    wall, tile = (plain, 1.0) if visuals.look == FIRST_LOOK else (back, visuals.wall.tile)
    parts = {
        "the back wall": [(quad((x0, y1, z0), (w, 0, 0), (0, 0, h), visuals.wall.tile), back)],
        "the floor": [(quad((x0, y0, z0), (w, 0, 0), (0, d, 0), visuals.ground.tile), ground)],
    }
    if closed:
        parts |= {
            "the front wall": [(quad((x1, y0, z0), (-w, 0, 0), (0, 0, h), tile), wall)],
            "the left wall": [(quad((x0, y0, z0), (0, d, 0), (0, 0, h), tile), wall)],
            "the right wall": [(quad((x1, y1, z0), (0, -d, 0), (0, 0, h), tile), wall)],
            "the ceiling": [(quad((x0, y1, z1), (w, 0, 0), (0, -d, 0), 1.0), plain)],
        }
    return parts

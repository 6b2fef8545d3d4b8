"""What a user brings for the room, as looks: textures in place of drawn ones, and lights from an
image of the surroundings."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.data.episode.visuals import Surface, Triple, Visuals
from pipeline.world.looks.textures import Rgba

IMAGE = "image"
"""The pattern of a surface whose texture is an image; its seed is the image's number."""

# of the sphere: the brightest part of the upper half, which becomes the directional light
SUN_SHARE = 0.01
LOWEST_SUN = 0.35  # of the direction to it, upwards
BRIGHTNESS = 0.95  # irradiance over pi that the table gets, as in the clean room


def with_textures(
    visuals: Visuals, textures: Mapping[str, Sequence[tuple[Rgba, float]]], rng: np.random.Generator
) -> Visuals:
    """The visuals with an image, drawn from `rng`, on each surface whose kind has images."""
    changed = dict[str, Surface]()
    for kind, surface in (("table", "table"), ("wall", "wall"), ("floor", "ground")):
        if images := textures.get(kind):
            number = int(rng.integers(len(images)))
            pixels, metres = images[number]
            r, g, b = pixels[..., :3].reshape(-1, 3).mean(0) / 255
            changed[surface] = Surface(IMAGE, number, (float(r), float(g), float(b)), metres)
    return replace(visuals, **changed)


def lit_by(visuals: Visuals, radiance: NDArray[np.float32]) -> Visuals:
    """The visuals in the light of an equirectangular image (H,W,3), its middle away from the robot.

    The brightest hundredth of the sphere above the table is the directional light, the rest the
    ambient one, scaled so that the table is as bright as in the clean room; there are no lamps.
    """
    toward, solid = _directions(*radiance.shape[:2])
    light = radiance.astype(np.float64) * solid[..., None]
    above = np.maximum(toward[..., 2], 0)
    luminance = np.where(
        toward[..., 2] > LOWEST_SUN, radiance.astype(np.float64).sum(-1), -1.0
    ).ravel()
    order = np.argsort(-luminance, kind="stable")
    brightest = order[
        : max(1, int((np.cumsum(solid.ravel()[order]) < SUN_SHARE * 4 * np.pi).sum()))
    ]
    flat, ways = light.reshape(-1, 3), toward.reshape(-1, 3)
    way = (flat[brightest].sum(1, keepdims=True) * ways[brightest]).sum(0)
    way /= np.linalg.norm(way)
    sun = flat[brightest].sum(0) / np.pi
    ambient = (flat * above.reshape(-1, 1)).sum(0) / np.pi - sun * way[2]
    ambient = np.maximum(ambient, 0)
    scale = BRIGHTNESS / (ambient + sun * way[2]).mean()
    x, y, z = (-way).round(6).tolist()
    return replace(
        visuals,
        ambient=_color(ambient * scale),
        sun=_color(sun * scale),
        sun_direction=(x, y, z),
        points=(),
    )


def _directions(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (H,W,3) in the world of the pixels of an equirectangular image, and their solid
    angles (H,W)."""
    polar = (np.arange(height) + 0.5) / height * np.pi
    around = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None]
    way = np.stack(np.broadcast_arrays(sine * np.sin(around), sine * np.cos(around), cosine), -1)
    return way, np.broadcast_to(sine * (np.pi / height) * (2 * np.pi / width), (height, width))


def _color(light: NDArray[np.float64]) -> Triple:
    """Rounded, so that the last bit of a sum is none of an image."""
    r, g, b = light.round(6).tolist()
    return r, g, b

"""What a mesh file holds: triangles of one look each, and notes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pipeline.data.errors import DominoError
from pipeline.poses import Floats, Ints, Pixels
from pipeline.world.shapes import linear, srgb_of

type Color = tuple[float, float, float]


class MeshError(DominoError):
    """A mesh file that cannot be used."""


class MeshLook(NamedTuple):
    """The sRGB color 0-1 of a surface, and a texture (H,W,4) uint8 that replaces it."""

    color: Color | None = None
    texture: Pixels | None = None


NOTHING = MeshLook()


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one look: points (P,3) m, faces (M,3), uv (P,2), v down."""

    points: Floats
    faces: Ints
    look: MeshLook = NOTHING
    uv: Floats | None = None

    def moved(self, matrix: Floats) -> "Part":
        """The part under a matrix (4,4); triangles stay outward when mirrored."""
        mirrors = np.linalg.det(matrix[:3, :3]) < 0
        faces = self.faces[:, ::-1] if mirrors else self.faces
        points = self.points @ matrix[:3, :3].T + matrix[:3, 3]
        return replace(self, points=points, faces=faces)


class MeshFile(NamedTuple):
    """Parts, up axis, and a line for each guess or omission."""

    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()
    up: str = "z"


def joined(parts: Iterable[Part]) -> tuple[Part, ...]:
    groups: dict[tuple[Color | None, int, bool], list[Part]] = {}
    for part in parts:
        key = part.look.color, id(part.look.texture), part.uv is None
        groups.setdefault(key, []).append(part)
    joints = list[Part]()
    for group in groups.values():
        uvs = [part.uv for part in group if part.uv is not None]
        uv = np.concatenate(uvs) if uvs else None
        joints.append(Part(*stacked(group), group[0].look, uv))
    return tuple(joints)


def stacked(parts: Sequence[Part]) -> tuple[Floats, Ints]:
    """Points (P,3) and faces (M,3) of all parts."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return np.concatenate([part.points for part in parts]), np.concatenate(faces)


SHADES = 31  # per channel: what two colors of a palette differ by at least is 1/31


def painted(part: Part, colors: Floats) -> Part:
    """Triangles in their corners' mean sRGB color, from colors (P,3) 0-1, by a palette texture: the
    renderer has no vertex colors."""
    mean = np.clip(colors, 0, 1)[part.faces].mean(1)
    shades, which = np.unique(np.round(mean * SHADES), axis=0, return_inverse=True)
    if len(shades) == 1:
        r, g, b = mean.mean(0).tolist()
        return replace(part, look=MeshLook((r, g, b)), uv=None)
    side = int(np.ceil(np.sqrt(len(shades))))
    texture = np.full((side * side, 4), 255, np.uint8)
    texture[: len(shades), :3] = np.round(shades / SHADES * 255)
    texel = which.ravel()
    uv = (np.stack([texel % side, texel // side], 1) + 0.5) / side
    r, g, b = mean.mean(0).tolist()
    return Part(
        part.points[part.faces].reshape(-1, 3),
        np.arange(3 * len(part.faces)).reshape(-1, 3),
        MeshLook((r, g, b), texture.reshape(side, side, 4)),
        np.repeat(uv, 3, axis=0),
    )


def srgb(light: Floats) -> Floats:
    """The sRGB of linear light, clipped to 0-1."""
    return srgb_of(np.clip(light, 0, 1))


def tinted(image: Pixels, color: Floats) -> Pixels:
    """A texture (H,W,4) times sRGB (3,), in linear light."""
    if np.allclose(color, 1):
        return image
    out = image.copy()
    out[..., :3] = np.round(255 * srgb(linear(image[..., :3] / 255.0) * linear(color)))
    return out

"""How a rigid body looks and collides, as plain data (m, z up, objects: origin at the base's
centre). Colours are sRGB 0-1."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, wraps
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.poses import IDENTITY, Floats, Floats32, Pixels, Pose, quat_rotate, transform


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (N,3) m, triangles (M,3), unit normals (N,3), uvs (N,2) or None."""

    vertices: Floats32
    triangles: NDArray[np.uint32]
    normals: Floats32
    uvs: Floats32 | None = field(default_factory=lambda: None)

    def moved(self, by: Pose) -> "Mesh":
        return Mesh(
            transform(by, self.vertices).astype(np.float32),
            self.triangles,
            quat_rotate(by[3:], self.normals).astype(np.float32),
            self.uvs,
        )


class _Deferred(Mesh):
    """A mesh whose arrays are computed when first read."""

    def __init__(self, make: Callable[[], Mesh]) -> None:
        self.__dict__["_make"] = make

    def __getattr__(self, name: str) -> Any:
        if name not in Mesh.__dataclass_fields__ or "_make" not in self.__dict__:
            raise AttributeError(name)
        made = self.__dict__["_make"]()
        self.__dict__.update({array: getattr(made, array) for array in Mesh.__dataclass_fields__})
        del self.__dict__["_make"]
        # what takes it apart, as dataclasses.replace does, finds a Mesh
        object.__setattr__(self, "__class__", Mesh)
        return self.__dict__[name]

    def __reduce__(self) -> tuple[type[Mesh], tuple[Any, ...]]:
        return Mesh, (self.vertices, self.triangles, self.normals, self.uvs)

    def moved(self, by: Pose) -> Mesh:
        return _Deferred(lambda: Mesh.moved(self, by))


def deferred[**P](make: Callable[P, Mesh]) -> Callable[P, Mesh]:
    """Decorator: compute the mesh when first read. Planning and simulation need the collision
    pieces alone."""

    @wraps(make)
    def later(*arguments: P.args, **options: P.kwargs) -> Mesh:
        return _Deferred(lambda: make(*arguments, **options))

    return later


def quads(*corners: NDArray[np.integer]) -> NDArray[np.integer]:
    """Triangles (2M,3) of M quadrilaterals from the indices (M,) of their corners."""
    a, b, c, d = corners
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def linear(color: ArrayLike) -> Floats:
    """Linear light 0-1 of sRGB 0-1 (IEC 61966-2-1)."""
    c = np.asarray(color, float)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def srgb_of(light: ArrayLike) -> Floats:
    """The inverse of `linear`."""
    c = np.asarray(light, float)
    return np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh; if any has uvs, the others get zeros."""
    offsets = np.cumsum([0, *(len(m.vertices) for m in meshes[:-1])])
    textured = any(m.uvs is not None for m in meshes)
    uvs = [np.zeros((len(m.vertices), 2), np.float32) if m.uvs is None else m.uvs for m in meshes]
    triangles = [m.triangles + offset for m, offset in zip(meshes, offsets, strict=True)]
    return Mesh(
        np.concatenate([m.vertices for m in meshes]).astype(np.float32),
        np.concatenate(triangles).astype(np.uint32),
        np.concatenate([m.normals for m in meshes]).astype(np.float32),
        np.concatenate(uvs).astype(np.float32) if textured else None,
    )


@dataclass(frozen=True)
class TextureSource:
    """A kind of `materials.TEXTURES` and its arguments."""

    kind: str
    arguments: tuple[str | int | float | tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class Material:
    """A surface: sRGB colour, roughness and metallic 0-1. A texture (H,W,4) uint8 sRGB replaces the
    colour."""

    color: tuple[float, float, float]
    roughness: float = 0.6
    metallic: float = 0.0
    texture: Pixels | None = None
    source: TextureSource | None = None


@deferred
def seen_along(mesh: Mesh, axes: Floats, tile: ArrayLike) -> Mesh:
    """The mesh with uvs projected along one direction, from its smallest corner: `axes` (2,3) are
    the directions of u and v, `tile` the size (m) of an image, or of its two sides."""
    across = mesh.vertices @ np.asarray(axes, np.float32).T
    uvs = ((across - across.min(0)) / np.asarray(tile)).astype(np.float32)
    return Mesh(mesh.vertices, mesh.triangles, mesh.normals, uvs)


type Parts = Sequence[tuple[Mesh, Material]]


@dataclass(frozen=True, eq=False)
class Collider:
    """One convex piece. Sizes: box half extents, sphere (r,), cylinder and capsule (r, half length)
    along z, convex () with `vertices` (N,3). `pose` is in the body frame, `weight` the relative
    density, `measured` a convex piece's volume (m^3)."""

    kind: str
    size: tuple[float, ...]
    pose: Pose = field(default_factory=lambda: IDENTITY)
    vertices: Floats | None = None
    weight: float = 1.0
    measured: float | None = None

    def volume(self) -> float:
        """The volume (m^3); of an unmeasured convex piece its bounding box's."""
        if self.measured is not None:
            return self.measured
        if self.kind == "box":
            return 8.0 * float(np.prod(self.size))
        if self.kind == "sphere":
            return 4.0 / 3.0 * np.pi * self.size[0] ** 3
        if self.kind == "cylinder":
            return 2.0 * np.pi * self.size[0] ** 2 * self.size[1]
        if self.kind == "capsule":
            return np.pi * self.size[0] ** 2 * (2.0 * self.size[1] + 4.0 / 3.0 * self.size[0])
        assert self.vertices is not None
        return float(np.prod(np.ptp(self.vertices, axis=0)))

    def support_points(self) -> Floats:
        """Points (N,3), body frame, whose hull contains the piece."""
        if self.vertices is not None:
            return transform(self.pose, self.vertices)
        half = np.array(self.size)
        if self.kind == "sphere":
            half = np.full(3, self.size[0])
        elif self.kind != "box":
            r, h = self.size
            half = np.array([r, r, h + (r if self.kind == "capsule" else 0.0)])
        return transform(self.pose, np.array(list(product((-1, 1), repeat=3))) * half)


@dataclass(frozen=True, eq=False)
class Shape:
    """Mass in kg, Coulomb friction coefficient."""

    visual: tuple[tuple[Mesh, Material], ...]
    collision: tuple[Collider, ...]
    mass: float
    friction: float = 0.6

    def aabb(self) -> Floats:
        """Lower and upper corner (2,3) of the pieces in the body frame; read-only."""
        return self._bounds

    @cached_property
    def _bounds(self) -> Floats:
        points = np.concatenate([c.support_points() for c in self.collision])
        bounds = np.stack([points.min(0), points.max(0)])
        bounds.setflags(write=False)
        return bounds

    @cached_property
    def is_round(self) -> bool:
        """Whether it looks the same, within 1 mm, however it is turned about its z axis."""
        around = 2 * np.pi * np.arange(24) / 24
        heights = np.repeat([-1.0, 0.0, 1.0], 24)
        directions = np.stack([*np.tile([np.cos(around), np.sin(around)], 3), heights])
        points = np.concatenate([mesh.vertices for mesh, _ in self.visual])
        return bool(np.ptp((points @ directions).max(0).reshape(3, 24), axis=1).max() < 0.001)

    def footprint_radius(self) -> float:
        """Largest horizontal distance (m) from the origin."""
        lower, upper = self.aabb()
        return float(np.hypot(max(-lower[0], upper[0]), max(-lower[1], upper[1])))

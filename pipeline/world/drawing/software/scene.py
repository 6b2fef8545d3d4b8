"""Bodies and room as arrays, drawn by the processor without a graphics driver."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.data.cameras import CameraType
from pipeline.data.episode.visuals import Visuals
from pipeline.poses import IDENTITY, Floats, Floats32, Pixels
from pipeline.world.shapes import Material, Mesh, Parts, merge

from ..engine import FAR, NEAR
from ..shadows import ShadowMap
from ..surfaces import TABLE, channel, halved, plane_texture
from .casters import SoftwareCasters
from .changes import AROUND, Stale, sort_stale
from .light import Canvas, Geometry, Lamps, Texels
from .on_bodies import shade_bodies
from .on_planes import shade_plane
from .raster import NOTHING, Frame, Lens, fill_bodies, fill_quads, rotation, solids_of, turned

Shadows = ShadowMap[SoftwareCasters]

LEVELS = 4  # of a body's texture, each half as wide as the one before


class Bodies:
    """All bodies' triangles, with segmentation `numbers` by body; all cameras share poses."""

    def __init__(self, bodies: Mapping[str, Parts], numbers: Mapping[str, int]) -> None:
        meshes = [pair for parts in bodies.values() for pair in parts]
        vertices = [len(mesh.vertices) for mesh, _ in meshes]
        triangles = [len(mesh.triangles) for mesh, _ in meshes]
        self.solids = solids_of([merge([mesh for mesh, _ in parts]) for parts in bodies.values()])
        normals = _joined([mesh.normals for mesh, _ in meshes], 3)
        length = np.linalg.norm(normals, axis=1)
        self._normals = normals / np.maximum(length, np.float32(0.01))[:, None]
        textures = list[Pixels]()
        materials, uvs = list[list[float]](), list[ArrayLike]()
        for (mesh, material), count in zip(meshes, vertices, strict=True):
            textured = material.texture is not None and mesh.uvs is not None
            uvs.append(mesh.uvs if mesh.uvs is not None else np.zeros((count, 2)))
            materials.append(_surface(material, len(textures) if textured else -1))
            if material.texture is not None and textured:
                textures += [halved(np.array(material.texture), k) for k in range(LEVELS)]
        unused = np.zeros(len(length), np.float32)
        self.geometry = Geometry(
            self.solids.corners,
            np.repeat(np.arange(len(meshes), dtype=np.int32), triangles),
            np.column_stack([self._normals, length, self.solids.points, unused]),
            _joined(uvs, 2),
            np.array(materials, np.float32).reshape(-1, 6),
            pooled(textures, LEVELS),
        )
        spans = self.solids.spans
        owners = np.arange(len(bodies), dtype=np.uint16)
        self.of_triangle = np.repeat(owners, spans[:, 3] - spans[:, 2])
        self.order = {name: k for k, name in enumerate(bodies)}
        self.numbers = np.array([numbers.get(name, 0) for name in bodies] or [0], np.uint8)
        self.poses = np.tile(np.asarray(IDENTITY, float), (max(len(bodies), 1), 1))
        self.versions = np.zeros(len(self.poses), np.int64)

    def place(self, name: str, pose: Floats) -> None:
        """Set the world pose (7,) of a body."""
        k = self.order[name]
        if (self.poses[k] != pose).any():
            self.poses[k] = pose
            turned(self._normals, self.solids.spans[k], self.poses[k], self.geometry.vertices)
            self.versions[k] += 1


class Planes:
    """The room's rectangles, with textures as one type of camera sees them."""

    def __init__(self, planes: Mapping[str, Parts], kind: CameraType) -> None:
        quads, rows, images, walls = [], [], [], []
        for name, parts in planes.items():
            for mesh, material in parts:
                image = plane_texture(name, mesh, material, kind)
                surface = _surface(material, -1 if image is None else len(images))
                images += [] if image is None else [image]
                for k in range(0, len(mesh.vertices), 4):
                    rows.append(_plane(name, mesh, k, surface))
                    quads.append(mesh.vertices[[k, k + 1, k + 3]])
                    walls.append(name != TABLE)
        self.quads, self.rows = np.array(quads, float), np.array(rows, np.float32)
        self.walls, self.texels = np.array(walls), pooled(images, 1)


def _joined(arrays: Sequence[ArrayLike], width: int) -> Floats32:
    return np.concatenate([np.zeros((0, width)), *arrays]).astype(np.float32)


def _plane(name: str, mesh: Mesh, k: int, surface: Sequence[float]) -> list[float]:
    corner, along, _, across = mesh.vertices[k : k + 4].astype(float)
    uv = np.zeros((4, 2)) if mesh.uvs is None else mesh.uvs[k : k + 4].astype(float)
    edges = np.stack([along - corner, across - corner])
    turn = (uv[[1, 3]] - uv[0]).T @ (edges / (edges**2).sum(1, keepdims=True))
    place = np.column_stack([turn, uv[0] - turn @ corner])
    red, green, blue, roughness, _, texture = surface
    rest = roughness, texture, *place.ravel(), channel(name)
    return [*mesh.normals[k], red, green, blue, *rest]


def _surface(material: Material, texture: int) -> list[float]:
    """Albedo, roughness and metallic, from eight bits as in `engine.material_uv`, and texture."""
    seen = np.clip([*material.color, material.roughness, material.metallic], 0, 1)
    seen = np.rint(seen * 255) / 255
    return [*seen[:3] ** 2, *seen[3:], texture]


def pooled(images: Sequence[Pixels], levels: int) -> Texels:
    """Textures (H,W,4) one after the other; so many in turn are levels of one."""
    words = [np.ascontiguousarray(image).view(np.uint32).ravel() for image in images]
    sizes = [len(each) for each in words]
    places = [
        (first, image.shape[1], image.shape[0], levels)
        for first, image in zip(np.cumsum([0, *sizes]), images, strict=False)
    ]
    none = np.zeros(1, np.uint32)
    return Texels(np.concatenate([*words, none]), np.array(places or [(0, 1, 1, 1)], np.int32))


def lamps_of(visuals: Visuals, scattered: Sequence[float]) -> Lamps:
    """The lights of an episode."""
    sunward = -np.asarray(visuals.sun_direction, float)
    room = [visuals.ambient, sunward / np.linalg.norm(sunward), visuals.sun, scattered]
    points = [[*point.position, *point.color] for point in visuals.points]
    return Lamps(np.array(room, np.float32), np.array(points, np.float32).reshape(-1, 6))


class Picture:
    """What one camera shows. An image from where the last one was taken shades only pixels that
    may have changed."""

    def __init__(
        self, kind: CameraType, bodies: Bodies, planes: Planes, lamps: Lamps, shadows: Shadows
    ) -> None:
        self._bodies, self._planes, self._lamps, self._shadows = bodies, planes, lamps, shadows
        focal = kind.height / 2 / np.tan(np.radians(kind.fovy) / 2)
        self._lens = Lens(kind.width, kind.height, float(focal), NEAR, FAR)
        self._shape = kind.height, kind.width
        size = kind.width * kind.height
        seen = np.empty((len(bodies.solids.points), 5), np.float32)
        self._frame, self._before = (
            Frame(zeros[0], np.full(size, NOTHING, np.int32), zeros[1], zeros[2], seen)
            for zeros in np.zeros((2, 3, size), np.float32)
        )
        self._canvas = Canvas(np.zeros((size, 4), np.uint8), np.zeros(size, np.uint16))
        self._pixels = np.empty((len(planes.rows) + 2, size), np.int32)
        self._shown, self._pose = np.zeros(0, int), np.full(7, np.nan)
        self._versions = bodies.versions.copy()

    def place(self, name: str, pose: Floats) -> None:
        """Set the world pose (7,) of a body."""
        self._bodies.place(name, pose)

    def show(self, names: Iterable[str]) -> None:
        """Hide all other bodies."""
        order = self._bodies.order
        self._shown = np.array([order[name] for name in names if name in order], int)

    def take(self, kind: CameraType, shader: str, pose: ArrayLike) -> Self:
        """Draw from a world pose (7,)."""
        at, bodies, lens = np.asarray(pose), self._bodies, self._lens
        again = np.array_equal(at, self._pose)
        self._pose = at.copy()
        frame, self._before = self._before, self._frame
        self._frame = frame
        frame.inverse.fill(1 / FAR)
        frame.ids.fill(NOTHING)
        inward = rotation(at)[:, [1, 2, 0]] * (-1.0, -1.0, 1.0)  # right, down and forward
        outward = np.column_stack([inward.T, -at[:3] @ inward])
        quads = self._planes.quads @ inward + outward[:, 3]
        fill_quads(quads, self._planes.walls, lens, frame)
        fill_bodies(bodies.solids, self._shown, bodies.poses, outward, lens, frame)
        moved = bodies.versions != self._versions
        np.copyto(self._versions, bodies.versions)
        changed = self._shadows.changed.copy()
        if again and changed.any():
            # shadows on bodies are looked up around a pixel's texel, maybe in the next block
            for blocks in changed.view(np.uint8):
                cv2.dilate(blocks, AROUND, dst=blocks)
        stale = Stale(not again, self._before.ids, moved, changed.reshape(3, -1))
        canvas, planes = self._canvas, self._planes
        counts = sort_stale(
            frame, stale, canvas.blocks, bodies.of_triangle, planes.rows, self._pixels
        )
        groups = [row[:n] for row, n in zip(self._pixels, counts, strict=True)]
        camera = np.column_stack([inward, at[:3]]).astype(np.float32), lens
        light = self._lamps, self._shadows.casters.sunlight
        canvas.image[groups[0]] = 0
        shade_bodies(groups[1], frame, camera, bodies.geometry, light, canvas)
        for pixels, row in zip(groups[2:], planes.rows, strict=True):
            if len(pixels):
                shade_plane(pixels, frame, camera, (row, planes.texels), light, canvas)
        return self

    def get_picture(self, target: str) -> NDArray[Any]:
        """Image (H,W,4), depth buffer, or segmentation (H,W,1)."""
        if target == "GbufferDepth":
            inverse = self._frame.inverse.reshape(self._shape)
            return (np.float32(FAR) - np.float32(NEAR * FAR) * inverse) / np.float32(FAR - NEAR)
        if target == "Body":
            ids, owners = self._frame.ids, self._bodies.of_triangle
            numbers = np.append(self._bodies.numbers[owners], np.uint8(0))  # the last: no triangle
            return numbers[np.where(ids < 0, -1, ids)].reshape(*self._shape, 1)
        return self._canvas.image.reshape(*self._shape, 4)

    def close(self) -> None:
        """Nothing is held outside."""

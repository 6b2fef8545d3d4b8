"""Reads COLLADA (.dae) by pycollada: triangles with diffuse colors or textures."""

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from lxml import etree

from .files import find_or_note, parse_xml, pixels, read_bytes
from .part import MeshError, MeshFile, MeshLook, Part

MOST = 20_000  # placed geometries


def read_dae(file: Path, within: Path) -> MeshFile:
    """Parts in metres; files that it names lie below `within`. Raises MeshError."""
    import collada  # robots without such a file need no pycollada

    text = etree.tostring(parse_xml(read_bytes(file)))
    document: Any = collada.Collada(io.BytesIO(text), ignore=[collada.DaeError])
    if document.errors:
        raise MeshError(f"is no COLLADA that is read: {document.errors[0]}")
    metres = document.assetInfo.unitmeter
    metres = 1.0 if metres is None else metres
    if not 1e-6 <= metres <= 1e6:
        raise MeshError(f"has a unit of {metres:g} metres")
    unit, reader = np.diag([metres, metres, metres, 1.0]), _Reader(file, within)
    placed = () if document.scene is None else document.scene.objects("geometry")
    parts = list[Part]()
    for number, geometry in enumerate(placed):
        if number == MOST:
            raise MeshError(f"places more than {MOST} geometries")
        parts += [part.moved(unit @ geometry.matrix) for part in reader.parts(geometry)]
    up = document.assetInfo.upaxis[0].lower()
    return MeshFile(tuple(parts), tuple(dict.fromkeys(reader.notes)), up)


class _Reader:
    def __init__(self, file: Path, within: Path) -> None:
        self.file, self.within = file, within
        self.notes: list[str] = []
        self._images: dict[str, np.ndarray | None] = {}

    def parts(self, geometry: Any) -> Iterator[Part]:
        """The triangles of a bound geometry in its own frame, a part a primitive."""
        from collada.lineset import LineSet
        from collada.triangleset import TriangleSet

        for primitive in geometry.original.primitives:
            if isinstance(primitive, LineSet):
                self.notes.append("leaves out lines")
                continue
            if not isinstance(primitive, TriangleSet):
                primitive = primitive.triangleset()
            material = geometry.materialnodebysymbol.get(primitive.material)
            look = self._look(material.target.effect) if material else MeshLook()
            yield self._part(primitive, look)

    def _part(self, triangles: Any, look: MeshLook) -> Part:
        which = triangles.vertex_index
        if which is None or which.min(initial=0) < 0:
            raise MeshError("has a triangle of vertices that it does not hold")
        points = triangles.vertex[which].reshape(-1, 3).astype(float)
        part = Part(points, np.arange(which.size).reshape(-1, 3))
        if look.texture is None:
            return replace(part, look=look)
        if not triangles.texcoordset:
            self.notes.append("has a texture and no coordinates for it: it is not drawn")
            return replace(part, look=MeshLook(look.color))
        uv = triangles.texcoordset[0][triangles.texcoord_indexset[0]].reshape(-1, 2)
        return replace(part, look=look, uv=uv * [1, -1] + [0, 1])

    def _look(self, effect: Any) -> MeshLook:
        """The diffuse color or texture; for a material that only shines a lamp's color."""
        light = effect.emission if effect.shadingtype == "constant" else effect.diffuse
        if isinstance(light, tuple | list):
            r, g, b = np.clip(light[:3], 0, 1).tolist()
            return MeshLook((r, g, b))
        if light is None or isinstance(light, float):
            self.notes.append("has a material without a diffuse color")
            return MeshLook()
        return MeshLook((0.8, 0.8, 0.8), self._texture(light.sampler.surface.image.path or ""))

    def _texture(self, written: str) -> np.ndarray | None:
        if written not in self._images:
            name = unquote(written.strip()).removeprefix("file://")
            path = find_or_note(name, "texture", self.file.parent, self.within, self.notes)
            self._images[written] = path and pixels(read_bytes(path))
        return self._images[written]

"""Reads Wavefront OBJ with MTL: faces by material, Kd, map_Kd, vertex colors."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.poses import Floats

from .files import find_or_note, pixels, read_bytes
from .part import Color, MeshError, MeshFile, MeshLook, Part, painted, tinted


class _Material(NamedTuple):
    kd: Color | None = None
    texture: str = ""


type _Place = tuple[Path, Path, list[str]]
"""The folder of the OBJ file, that below which the files lie that it names, and the notes."""

type _Corners = list[tuple[int, int]]
"""Numbers of the point and the coordinates (-1: none) of each corner of triangles."""


def _triangles(corners: list[str], points: int, uvs: int) -> _Corners:
    named = (f"{corner}//".split("/")[:2] for corner in corners)
    at = [(_index(point, points), _index(uv, uvs) if uv else -1) for point, uv in named]
    return [corner for k in range(1, len(at) - 1) for corner in (at[0], at[k], at[k + 1])]


def _index(text: str, count: int) -> int:
    number = int(text)
    index = number - 1 if number > 0 else count + number
    if number == 0 or index < 0:
        raise MeshError("has a triangle of vertices that it does not hold")
    return index


def read_obj(file: Path, within: Path) -> MeshFile:
    """One part a material; files that it names lie below `within`. Raises MeshError."""
    notes: list[str] = []
    place = file.parent, within, notes
    library: dict[str, _Material] = {}
    points, uvs = list[list[float]](), list[list[float]]()
    groups: dict[str, _Corners] = {"": []}
    faces = groups[""]
    for word, rest in _lines(read_bytes(file)):
        if word == "v":
            points.append([float(v) for v in rest.split()])
        elif word == "vt":
            uvs.append([float(v) for v in f"{rest} 0".split()[:2]])
        elif word == "f":
            faces += _triangles(rest.split(), len(points), len(uvs))
        elif word == "usemtl":
            faces = groups.setdefault(rest, [])
        elif word == "mtllib":
            library |= _read_library(rest, place)
    if library and not any(faces for name, faces in groups.items() if name):
        notes.append("names a material library and uses none of it: it has no color")
    at, colors = _vertices(points, notes)
    texels = np.array(uvs, float).reshape(-1, 2)
    parts = []
    for name, faces in groups.items():
        if not faces:
            continue
        if name and name not in library:
            notes.append(f"uses the material {name[:60]!r}, which no mtllib holds: it has no color")
        corners = np.array(faces)
        if (corners.max(0) >= (len(at), max(len(texels), 1))).any():
            raise MeshError("has a triangle of vertices that it does not hold")
        used, index = np.unique(corners, axis=0, return_inverse=True)
        uv = texels[used[:, 1]] if len(texels) and used[:, 1].min() >= 0 else None
        part = Part(at[used[:, 0]], index.reshape(-1, 3), uv=uv)
        shade = None if colors is None else colors[used[:, 0]]
        parts.append(_looked(part, shade, library.get(name, _Material()), place))
    return MeshFile(tuple(parts), tuple(dict.fromkeys(notes)))


def _lines(data: bytes) -> Iterator[tuple[str, str]]:
    """First word and rest of each line; a backslash continues a line."""
    text = data.decode("utf-8", "replace").replace("\r", "").replace("\\\n", " ")
    for line in text.split("\n"):
        words = line.split(None, 1)
        if words and words[0][0] != "#":
            yield words[0], words[1].strip() if len(words) > 1 else ""


def _vertices(points: list[list[float]], notes: list[str]) -> tuple[Floats, Floats | None]:
    if any(len(point) < 3 for point in points):
        raise MeshError("has a vertex of fewer than 3 numbers")
    at = np.array([point[:3] for point in points], float).reshape(-1, 3)
    colored = [len(point) >= 6 for point in points]
    if not any(colored):
        return at, None
    if not all(colored):
        notes.append("has vertices without a color among others: they are white")
    return at, np.array([(*point[3:], 1, 1, 1)[:3] for point in points], float)


def _looked(part: Part, shade: Floats | None, material: _Material, place: _Place) -> Part:
    """The part in its texture, its points' colors `shade` (P,3), or its color."""
    kd, path = np.array(material.kd or (1.0, 1.0, 1.0)), None
    if material.texture and part.uv is None:
        place[2].append("has a texture and no coordinates for it: the color alone is used")
    elif material.texture:
        path = find_or_note(material.texture, "texture", *place)
    if path is not None and part.uv is not None:
        look = MeshLook((1.0, 1.0, 1.0), tinted(pixels(read_bytes(path)), kd))
        return replace(part, look=look, uv=part.uv * [1, -1] + [0, 1])
    if shade is not None:
        return painted(part, shade * kd)
    return replace(part, look=MeshLook(material.kd), uv=None)


def _read_library(name: str, place: _Place) -> dict[str, _Material]:
    """Materials of an MTL; if missing none, and a note."""
    path = find_or_note(name, "material library", *place)
    materials: dict[str, _Material] = {}
    current = ""
    for word, rest in _lines(read_bytes(path)) if path else ():
        if word == "newmtl":
            current = rest
            materials[current] = _Material()
        elif word == "Kd" and current in materials:
            r, g, b = np.clip([float(v) for v in (rest.split() * 3)[:3]], 0, 1).tolist()
            materials[current] = materials[current]._replace(kd=(r, g, b))
        elif word.lower() == "map_kd" and current in materials:
            materials[current] = materials[current]._replace(texture=rest)
        elif word in ("d", "Tr") and float(rest.split()[-1]) != (1.0 if word == "d" else 0.0):
            place[2].append("draws a transparent material as opaque")
    return materials

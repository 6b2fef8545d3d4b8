"""Reads COLLADA (.dae) as ROS does: triangles with diffuse colors or textures."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from lxml import etree

from pipeline.poses import Floats, Ints, matrix, pose, quat_about

from .files import find_or_note, parse_xml, pixels, read_bytes
from .part import MeshError, MeshFile, MeshLook, Part

DEEPEST = 100  # instances of nodes inside each other
MOST = 20_000  # placed geometries

type Element = Any


def read_dae(file: Path, within: Path) -> MeshFile:
    """Parts in metres; files that it names lie below `within`. Raises MeshError."""
    root = parse_xml(read_bytes(file))
    for element in root.iter(etree.Element):
        element.tag = etree.QName(element).localname
    reader = _Reader(file, within, root)
    parts = tuple(part.moved(reader.unit()) for part in reader.parts())
    up = (root.findtext("asset/up_axis") or "Y_UP").strip()[:1].lower()
    return MeshFile(parts, tuple(dict.fromkeys(reader.notes)), up)


class _Reader:
    def __init__(self, file: Path, within: Path, root: Element) -> None:
        self.file, self.within, self.root = file, within, root
        self.notes: list[str] = []
        self._by_id = {e.get("id"): e for e in root.iter(etree.Element) if e.get("id")}
        self._images: dict[str, np.ndarray | None] = {}
        self._placed = 0

    def unit(self) -> Floats:
        unit = self.root.find("asset/unit")
        metres = 1.0 if unit is None else float(unit.get("meter", 1.0))
        if not 1e-6 <= metres <= 1e6:
            raise MeshError(f"has a unit of {metres:g} metres")
        return np.diag([metres, metres, metres, 1.0])

    def parts(self) -> Iterator[Part]:
        instance = self.root.find("scene/instance_visual_scene")
        if instance is None:
            for geometry in self.root.iterfind("library_geometries/geometry"):
                yield from self._geometry(geometry, {})
            return
        for node in self._target(instance).iterfind("node"):
            yield from self._node(node, np.eye(4), 0)

    def _target(self, element: Element, key: str = "url") -> Element:
        name = element.get(key, "")
        if not name.startswith("#") or name[1:] not in self._by_id:
            raise MeshError(f"<{element.tag}> names {name[:60]!r}, which the file does not hold")
        return self._by_id[name[1:]]

    def _node(self, node: Element, above: Floats, depth: int) -> Iterator[Part]:
        if depth > DEEPEST:
            raise MeshError(f"has nodes nested more than {DEEPEST} deep, or in a circle")
        at = above @ _placement(node)
        for element in node.iterchildren(etree.Element):
            if element.tag == "node":
                yield from self._node(element, at, depth + 1)
            elif element.tag == "instance_node":
                yield from self._node(self._target(element), at, depth + 1)
            elif element.tag == "instance_geometry":
                self._placed += 1
                if self._placed > MOST:
                    raise MeshError(f"places more than {MOST} geometries")
                materials = {m.get("symbol"): m for m in element.iter("instance_material")}
                for part in self._geometry(self._target(element), materials):
                    yield part.moved(at)

    def _geometry(self, geometry: Element, materials: dict[str | None, Element]) -> Iterator[Part]:
        mesh = geometry.find("mesh")
        for element in () if mesh is None else mesh.iterchildren(etree.Element):
            if element.tag in ("lines", "linestrips"):
                self.notes.append("leaves out lines")
            elif element.tag in ("triangles", "polylist"):
                yield self._primitive(element, materials.get(element.get("material")))
            elif element.find("p") is not None or element.find("ph") is not None:
                raise MeshError(f"has a <{element.tag}>, which is not read; make it triangles")

    def _primitive(self, element: Element, bound: Element | None) -> Part:
        inputs = [(int(i.get("offset", 0)), i) for i in element.iterfind("input")]
        stride = 1 + max(offset for offset, _ in inputs)
        rows = _numbers(_child(element, "p"), np.int64).reshape(-1, stride)
        corners = rows[_triangles(element, len(rows))]
        chosen = {i.get("semantic"): (offset, i) for offset, i in reversed(inputs)}
        offset, vertex = chosen["VERTEX"]
        sources = {i.get("semantic"): i for i in self._target(vertex, "source").iterfind("input")}
        points, which = self._source(sources["POSITION"])[:, :3], corners[..., offset]
        if not len(which) or which.min() < 0 or which.max() >= len(points):
            raise MeshError("has a triangle of vertices that it does not hold")
        part = Part(points[which].reshape(-1, 3), np.arange(which.size).reshape(-1, 3))
        look = MeshLook() if bound is None else self._look(self._target(bound, "target"))
        if look.texture is not None and "TEXCOORD" in chosen:
            offset, source = chosen["TEXCOORD"]
            uv = self._source(source)[:, :2][corners[..., offset].ravel()]
            return replace(part, look=look, uv=uv * [1, -1] + [0, 1])
        if look.texture is not None:
            self.notes.append("has a texture and no coordinates for it: it is not drawn")
        return replace(part, look=MeshLook(look.color))

    def _source(self, element: Element) -> Floats:
        source = self._target(element, "source")
        accessor = source.find("technique_common/accessor")
        array = source.find("float_array")
        if accessor is None or array is None:
            raise MeshError("has a source without numbers")
        stride, offset = int(accessor.get("stride", 1)), int(accessor.get("offset", 0))
        values = _numbers(array)[offset:]
        return values[: len(values) // stride * stride].reshape(-1, stride)

    def _look(self, material: Element) -> MeshLook:
        """The diffuse color or texture; for a material that only shines a lamp's color."""
        effect = self._target(_child(material, "instance_effect"))
        profile = _child(effect, "profile_COMMON")
        technique = _child(profile, "technique")
        for kind in ("phong", "lambert", "blinn", "constant"):
            shader = technique.find(kind)
            if shader is None:
                continue
            light = "emission" if kind == "constant" else "diffuse"
            color, texture = (shader.find(f"{light}/{tag}") for tag in ("color", "texture"))
            if texture is not None:
                return MeshLook((0.8, 0.8, 0.8), self._texture(texture.get("texture", ""), profile))
            if color is not None:
                r, g, b = np.clip(_numbers(color)[:3], 0, 1).tolist()
                return MeshLook((r, g, b))
        self.notes.append("has a material without a diffuse color")
        return MeshLook()

    def _texture(self, name: str, profile: Element) -> np.ndarray | None:
        for _ in range(3):  # a sampler, its surface, its image
            named = {p.get("sid"): p for p in reversed(profile.findall("newparam"))}
            if name not in named:
                break
            above = next(named[name].iter("source", "init_from", "instance_image"), None)
            name = ""
            if above is not None:
                name = (above.get("url", "").lstrip("#") or above.text or "").strip()
        image = self._by_id.get(name)
        start = None if image is None else next(image.iter("init_from"), None)
        written = "" if start is None else "".join(start.itertext()).strip()
        if written not in self._images:
            name, folder = unquote(written).removeprefix("file://"), self.file.parent
            path = find_or_note(name, "texture", folder, self.within, self.notes)
            self._images[written] = path and pixels(read_bytes(path))
        return self._images[written]


def _numbers(element: Element, kind: type = float) -> np.ndarray:
    return np.array((element.text or "").split(), kind)


def _child(element: Element, tag: str) -> Element:
    child = element.find(tag)
    if child is None:
        raise MeshError(f"has a <{element.tag}> without a <{tag}>")
    return child


def _placement(node: Element) -> Floats:
    out = np.eye(4)
    for element in node.iterchildren("matrix", "translate", "rotate", "scale", "lookat", "skew"):
        if element.tag in ("lookat", "skew"):
            raise MeshError(f"places a node by <{element.tag}>, which is not read; use <matrix>")
        values = _numbers(element)
        if element.tag == "matrix":
            step = values.reshape(4, 4)
        elif element.tag == "translate":
            step = matrix(pose(values[:3]))
        elif element.tag == "scale":
            step = np.diag([*values[:3], 1.0])
        else:
            step = matrix(pose((0, 0, 0), quat_about(values[:3], float(np.radians(values[3])))))
        out = out @ step
    return out


def _triangles(element: Element, count: int) -> Ints:
    """Triangles (M,3) of a primitive's `count` corners."""
    if element.tag == "triangles":
        return np.arange(count // 3 * 3).reshape(-1, 3)
    counts = np.array(element.findtext("vcount", "").split(), np.int64)
    starts = np.cumsum([0, *counts])
    if starts[-1] != count:
        raise MeshError("has a <polylist> whose vcount does not fit its corners")
    polygons = zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)
    faces = [(start, k, k + 1) for start, end in polygons for k in range(start + 1, end - 1)]
    return np.array(faces, np.int64).reshape(-1, 3)

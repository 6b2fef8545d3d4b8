"""Reads glTF 2.0: shapes and colors are applied, or refused by name (docs/mesh_files.md)."""

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np

from pipeline.poses import Floats, matrix, pose
from pipeline.world.files import split_glb

from .files import MAX_TRIANGLES, find_file, pixels, read_bytes
from .part import MeshError, MeshFile, MeshLook, Part, painted, srgb, tinted

TYPES = dict(zip((5120, 5121, 5122, 5123, 5125, 5126), map(np.dtype, "bBhHIf"), strict=True))
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
PACKED = re.compile("(KHR|EXT)_(draco_mesh|meshopt)_compression")
READ = {"KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp", "KHR_materials_unlit"}
LOOKS = re.compile("(KHR|EXT|MSFT)_(materials|lights|texture)_")
TRIANGLES = 4
MAX_NODES = 50_000


def read_gltf(file: Path, within: Path) -> MeshFile:
    """Read .glb or .gltf; files that it names lie below `within`. Raises MeshError."""
    data = read_bytes(file)
    is_binary = file.suffix.lower() == ".glb"
    reader = _Document(file, within, *(split_glb(data) if is_binary else (json.loads(data), b"")))
    reader.check_extensions()
    return MeshFile(tuple(reader.parts()), tuple(dict.fromkeys(reader.notes)), "y")


def _refuse_packed(extensions: dict[str, Any]) -> None:
    for name in filter(PACKED.fullmatch, extensions):
        raise MeshError(f"is packed by {name}: unpack it first, with `gltf-transform copy`")


class _Document:
    def __init__(self, file: Path, within: Path, document: Any, blob: bytes) -> None:
        if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
            raise MeshError("is no glTF 2.0 file")
        self.file, self.within, self.document, self.blob = file, within, document, blob
        self.notes: list[str] = []
        self._buffers: dict[int, bytes] = {}
        self._images: dict[int, np.ndarray] = {}

    def check_extensions(self) -> None:
        required = set(self.document.get("extensionsRequired", ()))
        for name in sorted(required | set(self.document.get("extensionsUsed", ()))):
            if name in required or name.startswith("KHR_draco"):
                _refuse_packed({name: None})
            if name == "EXT_mesh_gpu_instancing" or (
                name in required - READ and not LOOKS.match(name)
            ):
                raise MeshError(f"requires the extension {name[:60]!r}, which is not read")
            if name not in READ and not PACKED.fullmatch(name):
                self.notes.append(f"ignores the extension {name[:60]!r}")

    def _uri(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            return base64.b64decode(body) if head.endswith(";base64") else unquote_to_bytes(body)
        name = unquote_to_bytes(uri).decode()
        return read_bytes(find_file(name, self.file.parent, self.within))

    def _view(self, number: int) -> tuple[bytes, int]:
        view = self.document["bufferViews"][number]
        _refuse_packed(view.get("extensions", {}))
        which, start, length = view["buffer"], view.get("byteOffset", 0), view["byteLength"]
        if which not in self._buffers:
            uri = self.document["buffers"][which].get("uri")
            self._buffers[which] = self.blob if uri is None else self._uri(uri)
        data = self._buffers[which]
        if min(start, length) < 0 or start + length > len(data):
            raise MeshError("has a buffer view beyond the end of its buffer")
        return data[start : start + length], view.get("byteStride", 0)

    def array(self, number: int) -> Floats:
        """An accessor's numbers (N,W); normalized in their range."""
        accessor = self.document["accessors"][number]
        count, width = accessor["count"], WIDTHS[accessor["type"]]
        dtype = TYPES[accessor["componentType"]]
        if not 0 < count <= 3 * MAX_TRIANGLES:
            raise MeshError(f"has an array of {count} values; simplify it first")
        if "sparse" in accessor or "bufferView" not in accessor:
            raise MeshError("has a sparse array, which is not read: write all of its values")
        data, stride = self._view(accessor["bufferView"])
        offset, size = accessor.get("byteOffset", 0), width * dtype.itemsize
        stride = stride or size
        if stride < size or offset < 0 or offset + stride * (count - 1) + size > len(data):
            raise MeshError("has an accessor beyond the end of its buffer view")
        values = np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))
        if accessor.get("normalized") and dtype.kind in "iu":
            return np.maximum(values / float(np.iinfo(dtype).max), -1.0)
        return values.astype(np.float64)

    def parts(self) -> Iterator[Part]:
        total, read = 0, dict[int, list[Part]]()
        for mesh, at in self._placed():
            if mesh not in read:
                found = map(self._primitive, self.document["meshes"][mesh]["primitives"])
                read[mesh] = [part for part in found if part]
            total += sum(len(part.faces) for part in read[mesh])
            if total > MAX_TRIANGLES:
                raise MeshError(f"has more than {MAX_TRIANGLES} triangles; simplify it first")
            yield from (part.moved(at) for part in read[mesh])

    def _placed(self) -> Iterator[tuple[int, Floats]]:
        """Mesh and matrix (4,4) of every node with a mesh."""
        nodes, scenes = self.document.get("nodes", []), self.document.get("scenes", [])
        if len(nodes) > MAX_NODES:
            raise MeshError(f"has {len(nodes)} nodes; {MAX_NODES} at most, join them first")
        children = {child for node in nodes for child in node.get("children", ())}
        roots = [i for i in range(len(nodes)) if i not in children]
        if scenes:
            roots = scenes[self.document.get("scene", 0)].get("nodes", [])
        todo, seen = [(root, np.eye(4)) for root in roots], set[int]()
        while todo:
            number, at = todo.pop()
            if number in seen:
                raise MeshError("has a node with two parents, or nodes in a circle")
            seen.add(number)
            node = nodes[number]
            if {"matrix", "translation", "rotation", "scale"} & node.keys():
                at = at @ _matrix(node)
            if "mesh" in node:
                if "skin" in node:
                    self.notes.append("ignores the skin of a mesh: it is drawn as it is stored")
                yield node["mesh"], at
            todo += [(child, at) for child in reversed(node.get("children", ()))]

    def _primitive(self, primitive: dict[str, Any]) -> Part | None:
        at = primitive["attributes"]
        if primitive.get("mode", TRIANGLES) != TRIANGLES:
            self.notes.append("leaves out points, lines, strips or fans")
            return None
        _refuse_packed(primitive.get("extensions", {}))
        if "targets" in primitive:
            self.notes.append("ignores morph targets: the mesh is drawn without them")
        points = self.array(at["POSITION"])
        corners = np.arange(len(points))
        if "indices" in primitive:
            corners = self.array(primitive["indices"]).astype(np.int64).ravel()
        faces = corners[: len(corners) // 3 * 3].reshape(-1, 3)
        a, b, c = faces.T
        part = Part(points, faces[(a != b) & (b != c) & (c != a)])
        return self._looked(part, at, primitive.get("material"))

    def _looked(self, part: Part, at: dict[str, int], number: int | None) -> Part:
        material = {} if number is None else self.document["materials"][number]
        if material.get("alphaMode") == "BLEND":
            self.notes.append("draws a transparent surface as opaque")
        surface = material.get("pbrMetallicRoughness", {})
        factor = np.array(surface.get("baseColorFactor", (1, 1, 1))[:3], float)
        shades = self.array(at["COLOR_0"])[:, :3] if "COLOR_0" in at else None
        if shades is not None and len(shades) != len(part.points):
            raise MeshError("has colors of other vertices than it holds")
        info = surface.get("baseColorTexture")
        uv = self._uv(info, at, len(part.points)) if info else None
        if info and uv is not None and (image := self._texture(info["index"])) is not None:
            if shades is not None:
                self.notes.append("has a texture and colors of vertices: these are not drawn")
            look = MeshLook((1.0, 1.0, 1.0), tinted(image, srgb(factor)))
            return Part(part.points, part.faces, look, uv)
        if shades is not None:
            return painted(part, srgb(shades * factor))
        r, g, b = srgb(factor).tolist()
        return Part(part.points, part.faces, MeshLook(None if number is None else (r, g, b)))

    def _uv(self, info: dict[str, Any], at: dict[str, int], count: int) -> Floats | None:
        """Transformed coordinates (P,2); None without any."""
        change = info.get("extensions", {}).get("KHR_texture_transform", {})
        name = f"TEXCOORD_{change.get('texCoord', info.get('texCoord', 0))}"
        if name not in at:
            self.notes.append(f"has a texture and no {name} for it: the color alone is used")
            return None
        uv = self.array(at[name])
        if uv.shape != (count, 2):
            raise MeshError(f"has a {name} that does not fit its vertices")
        turn = change.get("rotation", 0.0)
        cos, sin = np.cos(turn), np.sin(turn)
        uv = uv * change.get("scale", (1, 1)) @ np.array([[cos, -sin], [sin, cos]])
        return uv + change.get("offset", (0, 0))

    def _texture(self, number: int) -> np.ndarray | None:
        """Pixels (H,W,4); None for an unknown format."""
        texture = self.document["textures"][number]
        webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
        source = webp.get("source", texture.get("source"))
        if source is None:
            self.notes.append("has a texture in a format that is not read: the color alone is used")
            return None
        if source not in self._images:
            image = self.document["images"][source]
            view = image.get("bufferView")
            data = self._uri(image["uri"]) if view is None else self._view(view)[0]
            self._images[source] = pixels(data)
        return self._images[source]


def _matrix(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    placed = matrix(pose(node.get("translation", (0, 0, 0)), (w, x, y, z)))
    return placed @ np.diag([*node.get("scale", (1, 1, 1)), 1.0])

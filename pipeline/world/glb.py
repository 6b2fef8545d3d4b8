"""Drawn surfaces as a binary glTF file: one mesh, a primitive per material, float32 arrays,
textures as PNG.

What `write_glb` writes is what `read_glb` reads, value for value. Files of other programs are for
`world/meshes`.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.errors import DominoError
from pipeline.data.reading import open_regular, read_regular
from pipeline.world.looks.png import read_png, write_png
from pipeline.world.shapes import Material, Mesh, Parts, deferred

GENERATOR = "domino-data"
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UINT = 5126, 5125
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
_DIGITS = 9  # of a colour: enough to get back the sRGB value that was picked


class GlbError(DominoError):
    """A GLB file that was not written by `write_glb`, or is damaged; the message names it."""


def write_glb(parts: Parts) -> bytes:
    """The GLB of meshes with their materials; the same parts give the same bytes."""
    blob, views, accessors, primitives, materials = (
        bytearray(),
        list[Any](),
        list[Any](),
        list[Any](),
        list[Any](),
    )
    images = list[Any]()

    def view(data: bytes) -> int:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        blob.extend(data + b"\0" * (-len(data) % 4))
        return len(views) - 1

    def put(array: NDArray[Any], kind: str, component: int) -> int:
        bounds = (
            {"min": array.min(0).tolist(), "max": array.max(0).tolist()} if kind == "VEC3" else {}
        )
        where = view(np.ascontiguousarray(array).tobytes())
        accessors.append(
            {
                "bufferView": where,
                "componentType": component,
                "count": array.size // _WIDTHS[kind],
                "type": kind,
            }
            | bounds
        )
        return len(accessors) - 1

    for mesh, material in parts:
        attributes = {
            "POSITION": put(mesh.vertices, "VEC3", _FLOAT),
            "NORMAL": put(mesh.normals, "VEC3", _FLOAT),
        }
        if mesh.uvs is not None:
            attributes["TEXCOORD_0"] = put(mesh.uvs, "VEC2", _FLOAT)
        primitives.append(
            {
                "attributes": attributes,
                "indices": put(mesh.triangles.ravel(), "SCALAR", _UINT),
                "material": len(materials),
            }
        )
        color = [round(_linear(c), _DIGITS) for c in material.color]
        surface = {
            "baseColorFactor": [*color, 1.0],
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        }
        if material.texture is not None:
            surface |= {
                "baseColorFactor": [1.0, 1.0, 1.0, 1.0],
                "baseColorTexture": {"index": len(images)},
            }
            images.append(
                {"bufferView": view(write_png(material.texture)), "mimeType": "image/png"}
            )
        materials.append({"pbrMetallicRoughness": surface})
    drawn = (
        {"images": images, "textures": [{"source": i} for i in range(len(images))]}
        if images
        else {}
    )
    text = json.dumps(
        {
            "asset": {"version": "2.0", "generator": GENERATOR},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": primitives}],
            "materials": materials,
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": len(blob)}],
        }
        | drawn,
        separators=(",", ":"),
    ).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<5I", _MAGIC, 2, 28 + len(text) + len(blob), len(text), _JSON)
    return head + text + struct.pack("<2I", len(blob), _BINARY) + bytes(blob)


def read_glb(path: Path) -> Parts:
    """The parts of a file of `write_glb`; their arrays are read when the first of them is used.
    Raises GlbError."""
    try:
        with open_regular(path) as file:
            magic, version, _, length, kind = struct.unpack("<5I", file.read(20))
            if (magic, version, kind) != (_MAGIC, 2, _JSON) or length > path.stat().st_size:
                raise ValueError("no header of a binary glTF file")
            document = json.loads(file.read(length))
        if document["asset"].get("generator") != GENERATOR:
            raise ValueError("written by another program")
        surfaces = [
            document["materials"][p["material"]]["pbrMetallicRoughness"]
            for p in document["meshes"][0]["primitives"]
        ]
        return tuple(
            (_mesh(path, i), _material(surface, _texture(path, document, surface)))
            for i, surface in enumerate(surfaces)
        )
    except (
        OSError,
        struct.error,
        ValueError,
        KeyError,
        IndexError,
        TypeError,
        AttributeError,
        RecursionError,
    ) as error:
        raise GlbError(
            f"{path}: not readable as a GLB of this project ({' '.join(str(error).split())})"
        ) from error


def _texture(
    path: Path, document: dict[str, Any], surface: dict[str, Any]
) -> NDArray[np.uint8] | None:
    """The image (H,W,4) of a surface, None without one. Raises ValueError for one that is
    damaged."""
    if "baseColorTexture" not in surface:
        return None
    image = document["images"][document["textures"][surface["baseColorTexture"]["index"]]["source"]]
    where = document["bufferViews"][image["bufferView"]]
    data = read_regular(path)
    start = 28 + struct.unpack_from("<I", data, 12)[0] + where["byteOffset"]
    coded = data[start : start + where["byteLength"]]
    return read_png(coded)


def _material(surface: dict[str, Any], texture: NDArray[np.uint8] | None) -> Material:
    r, g, b = (round(_srgb(c), 6) for c in surface["baseColorFactor"][:3])
    return Material(
        (r, g, b), float(surface["roughnessFactor"]), float(surface["metallicFactor"]), texture
    )


@deferred
def _mesh(path: Path, index: int) -> Mesh:
    data = read_regular(path)
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    start = 28 + length

    def array(number: int) -> NDArray[Any]:
        accessor = document["accessors"][number]
        view, width = document["bufferViews"][accessor["bufferView"]], _WIDTHS[accessor["type"]]
        dtype = np.float32 if accessor["componentType"] == _FLOAT else np.uint32
        values = np.frombuffer(data, dtype, accessor["count"] * width, start + view["byteOffset"])
        return values.reshape(-1, width)

    try:
        primitive = document["meshes"][0]["primitives"][index]
        at = primitive["attributes"]
        uvs = array(at["TEXCOORD_0"]) if "TEXCOORD_0" in at else None
        mesh = Mesh(
            array(at["POSITION"]),
            array(primitive["indices"]).reshape(-1, 3),
            array(at["NORMAL"]),
            uvs,
        )
        if not np.isfinite(mesh.vertices).all() or mesh.triangles.max(initial=0) >= len(
            mesh.vertices
        ):
            raise ValueError("a vertex is not finite, or a triangle names one that is not there")
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise GlbError(f"{path}: is damaged ({error})") from error
    return mesh


def _linear(c: float) -> float:
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4


def _srgb(c: float) -> float:
    return 12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055

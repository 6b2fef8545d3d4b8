"""Files of robots and objects: TOML settings and binary glTF."""

import json
import struct
import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, ValidationError

from pipeline.data.errors import DominoError
from pipeline.data.parsing import LARGEST_FILE, Strict, bounded, show_value
from pipeline.data.reading import read_regular
from pipeline.poses import Pixels

from .shapes import Material, Mesh, Parts, linear, srgb_of


class Table(Strict):
    """Tables of `robot.toml` and `object.toml`: no unknown keys, finite numbers."""

    model_config = ConfigDict(allow_inf_nan=False)


def read_toml[T: Table](file: Path, kind: type[T], wrong: type[DominoError]) -> T:
    """Read settings. Raises `wrong`, one line with file, key and fault."""
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise wrong(f"{file}: is larger than {LARGEST_FILE} bytes")
        return kind.model_validate(bounded(tomllib.loads(read_regular(file).decode())))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])[:80]
        fault = first["msg"].removeprefix("Value error, ")
        raise wrong(f"{file}: {key}: {fault} (got {show_value(first['input'])})") from error
    except (OSError, ValueError, RecursionError) as error:
        raise wrong(f"{file}: not readable ({' '.join(str(error).split())})") from error


LARGEST = 4096  # pixels along an edge


def read_png(coded: bytes) -> Pixels:
    """The image (H,W,4) RGBA of a PNG. Raises ValueError."""
    size, pixels = struct.unpack(">2I", coded[16:24]) if len(coded) > 24 else (0, 0), None
    if 0 < max(size) <= LARGEST:
        pixels = cv2.imdecode(np.frombuffer(coded, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.shape[2:] != (4,) or pixels.dtype != np.uint8:
        raise ValueError(f"a texture is damaged, or larger than {LARGEST} pixels")
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA), np.uint8)


GENERATOR = "domino-data"
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UINT = 5126, 5125
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
_DIGITS = 9  # of a colour: enough to get back the sRGB value that was picked


class GlbError(DominoError):
    """A GLB damaged or not by `write_glb`."""


def write_glb(parts: Parts) -> bytes:
    """Binary glTF; equal parts give equal bytes."""
    blob = bytearray()
    views, accessors, primitives, materials, images = (list[Any]() for _ in range(5))

    def view(data: bytes) -> int:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        blob.extend(data + b"\0" * (-len(data) % 4))
        return len(views) - 1

    def put(array: NDArray[Any], kind: str, component: int) -> int:
        count = array.size // _WIDTHS[kind]
        where = view(np.ascontiguousarray(array).tobytes())
        each = {"bufferView": where, "componentType": component, "count": count, "type": kind}
        if kind == "VEC3":
            each |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        accessors.append(each)
        return len(accessors) - 1

    for mesh, material in parts:
        attributes = {
            "POSITION": put(mesh.vertices, "VEC3", _FLOAT),
            "NORMAL": put(mesh.normals, "VEC3", _FLOAT),
        }
        if mesh.uvs is not None:
            attributes["TEXCOORD_0"] = put(mesh.uvs, "VEC2", _FLOAT)
        indices = put(mesh.triangles.ravel(), "SCALAR", _UINT)
        drawn = {"attributes": attributes, "indices": indices, "material": len(materials)}
        primitives.append(drawn)
        color = np.round(linear(material.color), _DIGITS).tolist()
        surface = {
            "baseColorFactor": [*color, 1.0],
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        }
        if material.texture is not None:
            surface["baseColorFactor"] = [1.0, 1.0, 1.0, 1.0]
            surface["baseColorTexture"] = {"index": len(images)}
            png = cv2.imencode(".png", cv2.cvtColor(material.texture, cv2.COLOR_RGBA2BGRA))[1]
            images.append({"bufferView": view(png.tobytes()), "mimeType": "image/png"})
        materials.append({"pbrMetallicRoughness": surface})
    document = {
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
    if images:
        document |= {"images": images, "textures": [{"source": i} for i in range(len(images))]}
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<5I", _MAGIC, 2, 28 + len(text) + len(blob), len(text), _JSON)
    return head + text + struct.pack("<2I", len(blob), _BINARY) + bytes(blob)


def split_glb(data: bytes) -> tuple[Any, bytes]:
    """JSON and binary chunk (empty if it has none) of a binary glTF file. Raises ValueError and
    struct.error."""
    magic, version, _, length, kind = struct.unpack_from("<5I", data)
    if (magic, version, kind) != (_MAGIC, 2, _JSON):
        raise ValueError("no header of a binary glTF 2.0 file")
    rest, blob = data[20 + length :], b""
    if len(rest) >= 8 and struct.unpack_from("<2I", rest)[1] == _BINARY:
        blob = rest[8 : 8 + struct.unpack_from("<I", rest)[0]]
    return json.loads(data[20 : 20 + length]), blob


def read_glb(path: Path) -> Parts:
    """Parts of `write_glb`. Raises GlbError."""
    try:
        document, blob = split_glb(read_regular(path))
        if document["asset"].get("generator") != GENERATOR:
            raise ValueError("written by another program")
        primitives = document["meshes"][0]["primitives"]
        return tuple(_part(document, blob, each) for each in primitives)
    except Exception as error:  # whatever a damaged file leads to
        why = " ".join(str(error).split())
        raise GlbError(f"{path}: not readable as a GLB of this project ({why})") from error


def _part(
    document: dict[str, Any], blob: bytes, primitive: dict[str, Any]
) -> tuple[Mesh, Material]:
    views = document["bufferViews"]

    def array(number: int) -> NDArray[Any]:
        accessor = document["accessors"][number]
        width, start = _WIDTHS[accessor["type"]], views[accessor["bufferView"]]["byteOffset"]
        dtype = np.float32 if accessor["componentType"] == _FLOAT else np.uint32
        return np.frombuffer(blob, dtype, accessor["count"] * width, start).reshape(-1, width)

    at = primitive["attributes"]
    mesh = Mesh(
        array(at["POSITION"]),
        array(primitive["indices"]).reshape(-1, 3),
        array(at["NORMAL"]),
        array(at["TEXCOORD_0"]) if "TEXCOORD_0" in at else None,
    )
    if not np.isfinite(mesh.vertices).all() or mesh.triangles.max(initial=0) >= len(mesh.vertices):
        raise ValueError("a vertex is not finite, or a triangle names one that is not there")
    surface, texture = document["materials"][primitive["material"]]["pbrMetallicRoughness"], None
    if "baseColorTexture" in surface:
        source = document["textures"][surface["baseColorTexture"]["index"]]["source"]
        where = views[document["images"][source]["bufferView"]]
        start = where["byteOffset"]
        texture = read_png(blob[start : start + where["byteLength"]])
    r, g, b = np.round(srgb_of(surface["baseColorFactor"][:3]), 6).tolist()
    roughness, metallic = float(surface["roughnessFactor"]), float(surface["metallicFactor"])
    return mesh, Material((r, g, b), roughness, metallic, texture)

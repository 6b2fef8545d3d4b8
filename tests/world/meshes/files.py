"""Small mesh files that the tests write."""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
TWO = np.array([0, 1, 2, 0, 2, 3], np.uint16)
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
COMPONENTS = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}
RED_LEFT = np.array([[[255, 0, 0], [0, 0, 255]]] * 2, np.uint8)
"""A texture (2,2,3): red on the left, blue on the right."""


def png(pixels) -> bytes:
    """An image (H,W,3) as PNG."""
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(out, "PNG")
    return out.getvalue()


class Glb:
    """A GLB of one primitive, a square of 1 m, whose document the tests change."""

    def __init__(self) -> None:
        self.blob = bytearray()
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {}}],
            "accessors": [],
            "bufferViews": [],
        }
        self.primitive: dict[str, Any] = self.document["meshes"][0]["primitives"][0]
        self.surface: dict[str, Any] = self.document["materials"][0]["pbrMetallicRoughness"]
        self.primitive["attributes"]["POSITION"] = self.accessor(SQUARE)
        self.primitive["indices"] = self.accessor(TWO)

    def view(self, data: bytes) -> int:
        """A buffer view of some bytes."""
        self.blob += b"\0" * (-len(self.blob) % 4)
        self.document["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)}
        )
        self.blob += data
        return len(self.document["bufferViews"]) - 1

    def accessor(self, values, normalized=False) -> int:
        """An accessor of an array (N,) or (N,W)."""
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        entry = {
            "bufferView": self.view(values.tobytes()),
            "componentType": COMPONENTS[values.dtype.char],
            "count": len(values),
        }
        self.document["accessors"].append(entry | {"type": kind, "normalized": normalized})
        return len(self.document["accessors"]) - 1

    def texture(self, pixels, **info) -> None:
        """Give the material a texture."""
        self.document |= {
            "images": [{"bufferView": self.view(png(pixels)), "mimeType": "image/png"}],
            "textures": [{"source": 0}],
        }
        self.surface["baseColorTexture"] = {"index": 0} | info

    def write(self, path: Path, **changes) -> Path:
        """The file, with changes of the document's keys."""
        self.document["buffers"] = [{"byteLength": len(self.blob)}]
        text = json.dumps(self.document | changes).encode()
        text += b" " * (-len(text) % 4)
        body = bytes(self.blob) + b"\0" * (-len(self.blob) % 4)
        head = struct.pack("<5I", 0x46546C67, 2, 28 + len(text) + len(body), len(text), 0x4E4F534A)
        path.write_bytes(head + text + struct.pack("<2I", len(body), 0x004E4942) + body)
        return path


DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>{unit}<up_axis>Z_UP</up_axis></asset>
<library_effects>{effects}</library_effects><library_materials>{materials}</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="t"><float_array id="ta" count="8">0 1 1 1 1 0 0 0</float_array>
<technique_common><accessor source="#ta" count="4" stride="2"><param name="S" type="float"/><param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{primitives}</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node>{place}<instance_geometry url="#g"><bind_material><technique_common>{bound}
</technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""  # noqa: E501


def dae(path: Path, colors=((1, 0, 0),), primitives=None, unit="", place="") -> Path:
    """A COLLADA file of a square, one primitive a material, each with its diffuse color."""
    made = primitives or [
        f'<triangles count="2" material="m{k}"><input semantic="VERTEX" source="#v"'
        ' offset="0"/><p>0 1 2 0 2 3</p></triangles>'
        for k in range(len(colors))
    ]
    effects = "".join(
        f'<effect id="e{k}"><profile_COMMON><technique sid="c"><phong><diffuse><color>{r} {g} {b}'
        " 1</color></diffuse></phong></technique></profile_COMMON></effect>"
        for k, (r, g, b) in enumerate(colors)
    )
    materials = "".join(
        f'<material id="n{k}"><instance_effect url="#e{k}"/></material>' for k in range(len(colors))
    )
    bound = "".join(
        f'<instance_material symbol="m{k}" target="#n{k}"/>' for k in range(len(colors))
    )
    path.write_text(
        DAE.format(
            unit=unit,
            effects=effects,
            materials=materials,
            primitives="".join(made),
            place=place,
            bound=bound,
        )
    )
    return path

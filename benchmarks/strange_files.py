"""Strange files of robots, objects, textures and light: each is read as it is meant, or refused in
one line.

python -m benchmarks.strange_files [NAME ...]

Every case is read as `robots add`, `objects add` and recipes read it, in a child process with
limits. Prints the processor seconds, and the line of a refusal. It fails for a wrong value, a line
that is none, more than PATIENCE seconds, and for a file beside the case's own folder that is read,
written or removed.
"""

import argparse
import os
import re
import resource
import struct
import sys
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.data.brought import bring_light, bring_textures
from pipeline.data.errors import DominoError
from pipeline.data.limited import LimitError, Limits, run_limited
from pipeline.intake.objects.add import draft_all
from pipeline.intake.objects.draft import Options as ObjectOptions
from pipeline.intake.robots.add import Options as RobotOptions
from pipeline.intake.robots.add import draft_robot
from pipeline.world.meshes.part import Part, srgb
from pipeline.world.meshes.reader import read_mesh
from pipeline.world.objects.from_files import ObjectError, read_settings
from pipeline.world.robots.surfaces import parts_of
from pipeline.world.robots.urdf_file import read_urdf
from tests.intake.robots.tiny import Tiny
from tests.world.meshes.files import RED_LEFT, SQUARE, TWO, UV, Glb, dae, png

PATIENCE = 30.0  # processor seconds of a case
LIMITS = Limits(memory=1 << 30, processor=45, wall=120.0, file=64 << 30)
# seconds since 1970: a file with an older time of access than of change gets a new one when it is
# read
OLD = 10**9
SQUARE_OBJ = "v 0 0 0\nv .1 0 0\nv .1 .1 0\nv 0 .1 0\n"
TEXELS = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
MJCF = (
    '<mujoco>{}<worldbody><body name="a"><joint/><geom size="0.1"/>{}</body></worldbody></mujoco>'
)


class Case(NamedTuple):
    """What is read, given the folder of the case: its value is judged, or its refusal matched."""

    name: str
    read: Callable[[Path], Any]
    words: str = ""
    judge: Callable[[Any], bool] = bool


def robot(
    urdf: str | Tiny, base: str | None = None, name: str = "arm.urdf", **files: Any
) -> Callable[[Path], Any]:
    """Reads a robot's file as `robots add` does."""

    def read(folder: Path) -> Any:
        put(folder, files)
        (folder / name).write_text(urdf if isinstance(urdf, str) else urdf.text())
        return draft_robot(folder / name, RobotOptions("mine", folder / "made", base=base))

    return read


def shape(
    name: str, attributes: str = "", at: str = "pkg/urdf/arm.urdf", given: str = "pkg", **files: Any
) -> Callable[[Path], Any]:
    """The parts of a mesh that a URDF names."""

    def read(folder: Path) -> list[Part]:
        put(folder, files)
        urdf = folder / at
        urdf.parent.mkdir(parents=True, exist_ok=True)
        mesh = f"<geometry><mesh filename='{name}' {attributes}/></geometry>"
        urdf.write_text(f"<robot><link name='a'><visual>{mesh}</visual></link></robot>")
        (found,) = read_urdf(urdf, folder / given).links["a"].visuals
        return parts_of(found)[0]

    return read


def mesh(name: str, make: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """The parts of a mesh file and its notes."""

    def read(folder: Path) -> Any:
        make(folder / name)
        return read_mesh(folder / name)

    return read


def thing(name: str, make: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """Reads an object's file as `objects add` does."""

    def read(folder: Path) -> Any:
        make(folder / name)
        return draft_all(folder / name, ObjectOptions("mine", "tea_box", folder / "made"))

    return read


def put(folder: Path, files: dict[str, Any]) -> None:
    """Write files by path: bytes, or a function of the path."""
    for name, content in files.items():
        path = folder / name.replace("__", "/").replace("_DOT_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content)


def obj(text: str, mtl: str = "", **images: bytes) -> Callable[[Path], None]:
    """Writes an OBJ, `a.mtl` beside it, and images."""

    def make(path: Path) -> None:
        path.write_text(f"mtllib a.mtl\n{SQUARE_OBJ}{TEXELS}{text}")
        path.with_name("a.mtl").write_text(mtl)
        put(path.parent, images)

    return make


def glb(change: Callable[[Glb], Any] = lambda one: None, **keys: Any) -> Callable[[Path], None]:
    """Writes a GLB of a square, changed."""

    def make(path: Path) -> None:
        one = Glb()
        more = change(one)
        one.write(path, **keys, **(more if isinstance(more, dict) else {}))

    return make


def cone(path: Path) -> None:
    """A cone of 5 x 5 x 20 cm as STL."""
    import trimesh

    trimesh.creation.cone(0.05, 0.2).export(path)


def color(parts: Any, *wanted: Any) -> bool:
    """Whether parts have these sRGB colors, in this order."""
    found = [part.look.color for part in getattr(parts, "parts", parts)]
    return len(found) == len(wanted) and bool(np.allclose(found, wanted, atol=0.01))


def volume(parts: list[Part]) -> float:
    """The enclosed volume (m3): negative where a mesh is inside out."""
    return (
        sum(
            float(np.einsum("ij,ij->", a, np.cross(b, c)))
            for p in parts
            for a, b, c in [p.points[p.faces].transpose(1, 0, 2)]
        )
        / 6
    )


def texel(parts: Any) -> list[int]:
    """The pixel at the first point of the only part."""
    (part,) = parts.parts
    h, w = part.look.texture.shape[:2]
    u, v = np.clip(part.uv[0] % 1 * (w, h), 0, (w - 1, h - 1)).astype(int)
    return part.look.texture[v, u, :3].tolist()


def attribute(one: Glb, name: str, values: np.ndarray, normalized: bool = False) -> None:
    """Give the primitive an attribute."""
    one.primitive["attributes"][name] = one.accessor(values, normalized)


def textured(one: Glb, **info: Any) -> None:
    """Give the square a texture that is red on the left."""
    attribute(one, "TEXCOORD_0", (UV * [0.4, 1]).astype(np.float32))
    one.texture(RED_LEFT, **info)


def bomb(side: int = 30_000) -> bytes:
    """A PNG of side x side pixels in a few hundred bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")
        )

    head = side.to_bytes(4, "big") * 2 + bytes([8, 2, 0, 0, 0])
    body = chunk(b"IDAT", zlib.compress(bytes(1 << 20))) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + body


def object_directory(toml: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """The settings of an object's directory."""

    def read(folder: Path) -> Any:
        toml(folder / "object.toml")
        return read_settings(folder)

    return read


def link(to: str) -> Callable[[Path], None]:
    """Writes a symbolic link."""
    return lambda path: path.symlink_to(to)


def grown(path: Path) -> None:
    """A sparse file of 40 GB."""
    with open(path, "wb") as file:
        file.truncate(40 << 30)


LIMIT = 'lower="-2.6" upper="2.6"'
ROOT = (
    '<link name="world"/><joint name="free" type="{}"><parent link="world"/><child'
    ' link="base"/></joint>'
)
TINY = Tiny().text()
WITH: dict[str, Any] = {"pkg__meshes__cone_DOT_stl": cone}
SPACED: dict[str, Any] = {"pkg__meshes__my cone_DOT_stl": cone}
OTHER: dict[str, Any] = {"tool__meshes__cone_DOT_stl": cone}
PART = Tiny(mesh="part.stl")
PNG: dict[str, Any] = {"red_DOT_png": png(RED_LEFT)}
HALF = srgb(np.array([0.5, 0.25, 0.0]))
STL_BOMB = bytes(80) + struct.pack("<I", 2**31 - 1) + bytes(100)
DRACO: dict[str, Any] = {
    "extensionsUsed": ["KHR_draco_mesh_compression"],
    "extensionsRequired": ["KHR_draco_mesh_compression"],
}
MESHOPT: dict[str, Any] = {
    "extensionsUsed": ["EXT_meshopt_compression"],
    "extensionsRequired": ["EXT_meshopt_compression"],
}

CASES = (
    # right values of a URDF
    Case(
        "mirrored scale",
        shape("../meshes/cone.stl", "scale='1 -1 1'", **WITH),
        judge=lambda p: 4e-4 < volume(p) < 6e-4,
    ),
    Case(
        "../meshes from urdf/",
        shape("../meshes/cone.stl", **WITH),
        judge=lambda p: 4e-4 < volume(p) < 6e-4,
    ),
    Case("package by folder", shape("package://pkg/meshes/cone.stl", **WITH)),
    Case(
        "package by package.xml",
        shape(
            "package://arm/meshes/cone.stl",
            pkg__package_DOT_xml=b"<package><name>arm</name></package>",
            **WITH,
        ),
    ),
    Case("package beside", shape("package://tool/meshes/cone.stl", given=".", **WITH, **OTHER)),
    Case(
        "OBJ in two colors",
        mesh(
            "a.obj",
            obj(
                "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n"
            ),
        ),
        judge=lambda p: color(p, (1, 0, 0), (0, 0, 1)),
    ),
    Case(
        "DAE in two colors",
        mesh("a.dae", lambda p: dae(p, ((1, 0, 0), (0, 1, 0)))),
        judge=lambda p: color(p, (1, 0, 0), (0, 1, 0)),
    ),
    Case(
        "DAE in centimetres",
        mesh("a.dae", lambda p: dae(p, unit='<unit meter="0.01"/>')),
        judge=lambda p: np.allclose(np.ptp(p.parts[0].points, axis=0), [0.01, 0.01, 0]),
    ),
    Case(
        "floating root beyond the base",
        robot(TINY.replace("</robot>", ROOT.format("floating") + "</robot>"), base="base"),
    ),
    # refusals of a URDF
    Case(
        "package that is not here",
        shape("package://gone/meshes/cone.stl", **WITH),
        "package 'gone', which is not here",
    ),
    Case(
        "package of another's mesh",
        shape("package://tool/meshes/cone.stl", **WITH, **OTHER),
        "package 'tool', which is not here",
    ),
    Case("mesh outside", shape("../../secret.stl"), "is outside of"),
    Case("mesh by an absolute path", shape("/etc/hostname"), "is an absolute path"),
    Case("mesh by URL", shape("https://example.org/a.stl"), "is a URL"),
    Case(
        "percent signs",
        shape("../meshes/my%20cone.stl", **SPACED),
        "percent signs; write '../meshes/my cone",
    ),
    Case(
        "backslashes",
        shape("..\\meshes\\cone.stl", **WITH),
        "backslashes; write '../meshes/cone.stl'",
    ),
    Case(
        "wrong case",
        shape("../Meshes/CONE.STL", **WITH),
        "another case; write '../meshes/cone.stl'",
    ),
    Case(
        "mesh that is a link away",
        robot(PART, part_DOT_stl=link("/etc/hostname")),
        "is outside of|a link to a file outside",
    ),
    Case(
        "mesh that is /dev/zero",
        robot(PART, part_DOT_stl=link("/dev/zero")),
        "a link to a file outside",
    ),
    Case("mesh that is a pipe", robot(PART, part_DOT_stl=os.mkfifo), "is no regular file"),
    Case("mesh of 40 GB", robot(PART, part_DOT_stl=grown), "a file has at most"),
    Case("STL of 2 billion triangles", robot(PART, part_DOT_stl=STL_BOMB), "part.stl: "),
    Case(
        "OBJ that is not finite",
        robot(Tiny(mesh="a.obj"), a_DOT_obj=b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "not finite",
    ),
    Case(
        "limits of 0",
        robot(TINY.replace(LIMIT, 'lower="0" upper="0"')),
        "joint 'j3' has limits 0 to 0",
    ),
    Case(
        "floating root",
        robot(TINY.replace("</robot>", ROOT.format("floating") + "</robot>")),
        "'free' is floating.*--base base",
    ),
    Case(
        "planar root",
        robot(TINY.replace("</robot>", ROOT.format("planar") + "</robot>")),
        "'free' is planar",
    ),
    Case(
        "laughs",
        robot('<!DOCTYPE r [<!ENTITY a "b"><!ENTITY c "&a;&a;">]>' + TINY),
        "declares a document type",
    ),
    Case(
        "XML of 100,000 levels",
        robot("<robot>" + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>"),
        "arm.urdf: ",
    ),
    Case(
        "100,000 links",
        robot("<robot>" + "<link name='a'/>" * 100_000 + "</robot>"),
        "has 100000 links",
    ),
    Case("link named as a path", robot(TINY.replace('"upper"', '"../../up"')), "without slashes"),
    Case(
        "URDF that is /dev/zero",
        lambda f: (
            link("/dev/zero")(f / "arm.urdf"),
            draft_robot(f / "arm.urdf", RobotOptions("m", f)),
        )[1],
        "is no regular file",
    ),
    Case(
        "URDF that is a pipe",
        lambda f: (os.mkfifo(f / "arm.urdf"), draft_robot(f / "arm.urdf", RobotOptions("m", f)))[1],
        "arm.urdf",
    ),
    # MJCF
    Case(
        "MJCF of 10^8 replicas",
        robot(
            MJCF.format("", '<replicate count="100000000"><geom size=".1"/></replicate>'),
            name="a.xml",
        ),
        "a.xml",
    ),
    Case(
        "MJCF with a field of 200000^2",
        robot(
            MJCF.format(
                '<asset><hfield name="h" nrow="200000" ncol="200000" size="1 1 1 1"/></asset>', ""
            ),
            name="a.xml",
        ),
        "a.xml",
    ),
    Case(
        "MJCF that includes a pipe",
        robot(MJCF.format('<include file="p.xml"/>', ""), name="a.xml", p_DOT_xml=os.mkfifo),
        "is no regular file",
    ),
    Case(
        "MJCF that includes /etc/passwd",
        robot(MJCF.format('<include file="/etc/passwd"/>', ""), name="a.xml"),
        "which is outside of",
    ),
    Case(
        "MJCF with a texture elsewhere",
        robot(
            MJCF.format('<asset><texture type="2d" file="../../../../secret.png"/></asset>', ""),
            name="a.xml",
        ),
        "which is outside of",
    ),
    Case(
        "MJCF in a ring",
        robot(MJCF.format('<include file="a.xml"/>', ""), name="a.xml"),
        "twice or in a ring",
    ),
    # glTF
    Case(
        "quantized",
        mesh(
            "a.glb",
            glb(lambda g: attribute(g, "POSITION", (SQUARE * 32767).astype(np.int16), True)),
        ),
        judge=lambda p: np.allclose(p.parts[0].points, SQUARE),
    ),
    Case(
        "triangle fan",
        mesh(
            "a.glb",
            glb(
                lambda g: g.primitive.update(
                    mode=6, indices=g.accessor(np.arange(4, dtype=np.uint8))
                )
            ),
        ),
        judge=lambda p: len(p.parts[0].faces) == 2,
    ),
    Case(
        "triangle strip",
        mesh(
            "a.glb",
            glb(
                lambda g: g.primitive.update(
                    mode=5, indices=g.accessor(np.array([0, 1, 3, 2], np.uint8))
                )
            ),
        ),
        judge=lambda p: len(p.parts[0].faces) == 2,
    ),
    Case("texture, left", mesh("a.glb", glb(textured)), judge=lambda p: texel(p) == [255, 0, 0]),
    Case(
        "texture transform",
        mesh(
            "a.glb",
            glb(lambda g: textured(g, extensions={"KHR_texture_transform": {"offset": [0.55, 0]}})),
        ),
        judge=lambda p: texel(p) == [0, 0, 255],
    ),
    Case(
        "texCoord 1",
        mesh(
            "a.glb",
            glb(
                lambda g: (
                    textured(g, texCoord=1),
                    attribute(g, "TEXCOORD_1", (0.9 - UV * 0.3).astype(np.float32)),
                )[0]
            ),
        ),
        judge=lambda p: texel(p) == [0, 0, 255],
    ),
    Case(
        "factor times texture",
        mesh(
            "a.glb",
            glb(lambda g: (textured(g), g.surface.update(baseColorFactor=[0.5, 1, 1, 1]))[0]),
        ),
        judge=lambda p: abs(texel(p)[0] - 188) < 2,
    ),
    Case(
        "linear factor",
        mesh("a.glb", glb(lambda g: g.surface.update(baseColorFactor=[0.5, 0.25, 0, 1]))),
        judge=lambda p: color(p, HALF),
    ),
    Case(
        "colors of vertices",
        mesh(
            "a.glb",
            glb(
                lambda g: attribute(
                    g, "COLOR_0", np.tile(np.array([[0, 255, 0, 255]], np.uint8), (4, 1)), True
                )
            ),
        ),
        judge=lambda p: color(p, (0, 1, 0)),
    ),
    Case("Draco", mesh("a.glb", glb(**DRACO)), "Draco.*DracoPy"),
    Case("meshopt", mesh("a.glb", glb(**MESHOPT)), "meshopt"),
    Case(
        "unknown extension",
        mesh("a.glb", glb(extensionsRequired=["VENDOR_x"])),
        "requires the extension 'VENDOR_x'",
    ),
    Case("100,000 nodes", thing("a.glb", glb(nodes=[{"mesh": 0}] * 100_000)), "has 100000 nodes"),
    Case(
        "400,000 triangles in 300 nodes",
        thing(
            "a.glb",
            glb(
                lambda g: g.primitive.update(indices=g.accessor(np.tile(TWO, 200_000))),
                nodes=[{"mesh": 0}] * 300,
                scenes=[{"nodes": list(range(300))}],
            ),
        ),
        "triangles; 500000 at most|values",
    ),
    Case(
        "nodes in a circle",
        thing("a.glb", glb(nodes=[{"children": [1]}, {"children": [0]}])),
        "circle|no triangles",
    ),
    Case(
        "gltf with a buffer elsewhere",
        thing(
            "a.gltf",
            lambda p: p.write_text(
                '{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"../../secret.bin"}]}'
            ),
        ),
        "is outside of",
    ),
    Case(
        "accessor beyond its buffer",
        thing("a.glb", glb(lambda g: g.document["accessors"][0].update(count=10_000))),
        "beyond the end",
    ),
    Case(
        "accessor of 10^8",
        thing("a.glb", glb(lambda g: g.document["accessors"][0].update(count=10**8))),
        "100000000|triangles",
    ),
    Case(
        "negative offset",
        thing("a.glb", glb(lambda g: g.document["bufferViews"][0].update(byteOffset=-4))),
        "beyond the end",
    ),
    Case(
        "JSON of 100,000 levels",
        thing("a.gltf", lambda p: p.write_text('{"asset":' + "[" * 100_000 + "]" * 100_000 + "}")),
        "a.gltf",
    ),
    Case(
        "texture of 900 million pixels",
        thing(
            "a.obj",
            obj(
                "usemtl a\nf 1/1 2/2 3/3 4/4\n", "newmtl a\nmap_Kd bomb.png\n", bomb_DOT_png=bomb()
            ),
        ),
        "make it smaller",
    ),
    Case("GLB that is a pipe", thing("a.glb", os.mkfifo), "is no regular file"),
    Case(
        "zip called GLB",
        thing("a.glb", lambda p: p.write_bytes(b"PK\3\4" + bytes(100))),
        "no header",
    ),
    # OBJ, PLY, OFF, DAE
    Case(
        "20,000 groups",
        mesh("a.obj", obj("".join(f"g g{k}\nf 1 2 3\n" for k in range(20_000)))),
        judge=lambda p: len(p.parts) == 1,
    ),
    Case(
        "map_Kd with backslashes",
        mesh(
            "a.obj", obj("usemtl a\nf 1/1 2/2 3/3\n", "newmtl a\nmap_Kd C:\\me\\red.png\n", **PNG)
        ),
        judge=lambda p: "takes red.png" in p.notes[0],
    ),
    Case(
        "map_Kd with options",
        mesh(
            "a.obj", obj("usemtl a\nf 1/1 2/2 3/3\n", "newmtl a\nmap_Kd -s 2 2 1 red.png\n", **PNG)
        ),
        judge=lambda p: p.parts[0].uv.max() == 2.0 or p.parts[0].uv.min() == -1.0,
    ),
    Case(
        "map_Kd that is missing",
        mesh("a.obj", obj("usemtl a\nf 1/1 2/2 3/3\n", "newmtl a\nKd 1 0 0\nmap_Kd gone.png\n")),
        judge=lambda p: color(p, (1, 0, 0)) and "gone.png" in p.notes[0],
    ),
    Case(
        "map_Kd elsewhere",
        mesh("a.obj", obj("usemtl a\nf 1/1 2/2 3/3\n", "newmtl a\nmap_Kd ../../secret.png\n")),
        "is outside of",
    ),
    Case(
        "mtllib elsewhere",
        mesh("a.obj", lambda p: p.write_text(f"mtllib ../../secret.mtl\n{SQUARE_OBJ}f 1 2 3\n")),
        "is outside of",
    ),
    Case(
        "mtllib without usemtl",
        mesh("a.obj", obj("f 1 2 3\n", "newmtl a\nKd 1 0 0\n")),
        judge=lambda p: "uses none of it" in p.notes[0],
    ),
    Case(
        "OBJ with colors of vertices",
        mesh(
            "a.obj",
            lambda p: p.write_text("v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n"),
        ),
        judge=lambda p: color(p, (1, 0, 0)),
    ),
    Case(
        "PLY of 10^10 vertices",
        thing(
            "a.ply",
            lambda p: p.write_text(
                "ply\nformat ascii 1.0\nelement vertex 10000000000\nproperty float x\nend_header\n"
            ),
        ),
        "a.ply",
    ),
    Case(
        "OFF of 10^9 faces",
        thing(
            "a.off", lambda p: p.write_text("OFF\n3 1000000000 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
        ),
        "a.off",
    ),
    Case(
        "DAE with an entity",
        mesh(
            "a.dae",
            lambda p: p.write_text(
                '<!DOCTYPE c [<!ENTITY e SYSTEM "file:///etc/passwd">]><COLLADA>&e;</COLLADA>'
            ),
        ),
        "document type",
    ),
    Case(
        "DAE with nodes in a ring",
        mesh(
            "a.dae",
            lambda p: p.write_text(
                dae(p).read_text().replace("<node>", '<node id="n"><instance_node url="#n"/>')
            ),
        ),
        "in a circle",
    ),
    # directories, textures, light
    Case(
        "object.toml of 5,000 levels",
        object_directory(lambda p: p.write_text("a = " + "[" * 5000 + "]" * 5000)),
        "nested too deeply",
    ),
    Case("object.toml that is /dev/zero", object_directory(link("/dev/zero")), "object.toml"),
    Case("object.toml that is a pipe", object_directory(os.mkfifo), "object.toml"),
    Case(
        "config.yml with a tag",
        lambda f: (
            (f / "config.yml").write_text("a: !!python/object/apply:os.system [touch gone]"),
            draft_robot(f, RobotOptions("m", f)),
        )[1],
        "config.yml",
    ),
    Case(
        "model_data of 100,000 levels",
        lambda f: (
            cone(f / "base0.stl"),
            glb()(f / "base0.glb"),
            (f / "model_data0.json").write_text("[" * 100_000 + "]" * 100_000),
            draft_all(f, ObjectOptions("m", "tea_box", f)),
        )[3],
        "model_data0.json",
    ),
)


def unchanged(place: Path) -> str:
    """What the files of a folder are, with the time at which each was last read."""
    found = []
    for path in sorted(p for p in place.rglob("*") if p.is_file()):
        state = path.stat()
        found.append((path.name, state.st_size, state.st_atime, state.st_mtime))
    return repr(found)


def read_case(number: int, folder: Path) -> tuple[bool, str]:
    """The child's side: whether a case gives its value, and what it gives in short."""
    case = CASES[number]
    value = case.read(folder)
    return (
        not case.words and bool(case.judge(value)),
        f"{type(value).__name__}: {getattr(value, 'notes', '')}"[:120],
    )


def check(number: int, folder: Path) -> tuple[bool, str]:
    """Whether a case does what it should, and its line or value."""
    case = CASES[number]
    try:
        return run_limited(str(folder / "file"), read_case, number, folder, limits=LIMITS)
    except (DominoError, ObjectError) as error:
        line = str(error)
        good = (
            bool(case.words)
            and re.search(case.words, line) is not None
            and "\n" not in line
            and len(line) < 700
        )
        return (
            good or (bool(case.words) and isinstance(error, LimitError) and case.name in BOUNDED),
            line,
        )


BOUNDED = (
    "MJCF of 10^8 replicas",
    "MJCF with a field of 200000^2",
    "PLY of 10^10 vertices",
    "OFF of 10^9 faces",
)
"""Cases that a limit of the child may end."""


def images(place: Path) -> list[tuple[str, bool, str]]:
    """The cases of textures and light, which start a child of their own."""
    (place / "table").mkdir()
    (place / "table" / "bomb.png").write_bytes(bomb())
    (place / "sky.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 200000\n" + bytes(1000)
    )
    found = []
    for name, bring, given in (
        ("PNG bomb", bring_textures, place),
        ("HDR bomb", bring_light, place / "sky.hdr"),
    ):
        try:
            found.append((name, False, repr(bring(str(given)))))
        except DominoError as error:
            found.append((name, "make it smaller" in str(error), str(error)))
    return found


def spent() -> float:
    """Processor seconds of the children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def notes_reads(place: Path) -> bool:
    """Whether the file system keeps when a file was last read."""
    probe = place / "probe"
    probe.write_bytes(b"1")
    os.utime(probe, (OLD, OLD + 1))
    probe.read_bytes()
    seen = probe.stat().st_atime > OLD
    probe.unlink()
    return seen


def main() -> None:
    """Print every case, and end with 1 if one is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*")
    chosen = parser.parse_args().names
    wrong = 0
    with tempfile.TemporaryDirectory() as top:
        elsewhere = Path(top)
        reads = (
            "unread" if notes_reads(elsewhere) else "perhaps read: this file system does not tell"
        )
        for name in ("secret.stl", "secret.bin", "secret.png", "secret.mtl"):
            (elsewhere / name).write_bytes(b"newmtl a\nKd 1 0 0\n" + bytes(100))
            os.utime(elsewhere / name, (OLD, OLD + 1))
        before = unchanged(elsewhere)
        results = []
        for number, case in enumerate(CASES):
            if not chosen or any(name in case.name for name in chosen):
                folder = elsewhere / f"case{number}" / "in"
                folder.mkdir(parents=True)
                began = spent()
                good, line = check(number, folder)
                results.append(
                    (case.name, good and spent() - began < PATIENCE, line, spent() - began)
                )
                print(
                    f"{'ok  ' if results[-1][1] else 'FAIL'} {results[-1][3]:5.1f} s  {case.name}:"
                    f" {line.replace(top, '')[:150]}",
                    flush=True,
                )
                remove(folder)
        place = elsewhere / "images"
        place.mkdir()
        for name, good, line in images(place) if not chosen else ():
            results.append((name, good, line, 0.0))
            print(f"{'ok  ' if good else 'FAIL'}          {name}: {line.replace(top, '')[:150]}")
        remove(place)
        wrong = sum(not good for _, good, _, _ in results)
        kept = unchanged(elsewhere) == before
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss >> 10
    print(
        f"{len(results)} cases, {wrong} wrong, files elsewhere"
        f" {f'as they were, {reads}' if kept else 'TOUCHED'}, at most {peak} MB"
    )
    sys.exit(bool(wrong) or not kept)


def remove(folder: Path) -> None:
    """Remove a case's folder and the one above it."""
    import shutil

    shutil.rmtree(folder)
    if folder.name == "in":
        folder.parent.rmdir()


if __name__ == "__main__":
    main()

"""Files of a case as they are made: robots, meshes and directories, right and wrong."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.intake.objects.add import draft_all
from pipeline.intake.objects.draft import ObjectOptions
from pipeline.intake.robots.add import RobotOptions, draft_robot
from pipeline.world.meshes.part import Part, srgb
from pipeline.world.meshes.reader import read_mesh
from pipeline.world.objects.from_files import read_settings
from pipeline.world.robots.surfaces import parts_of
from pipeline.world.robots.urdf_file import read_urdf
from tests.intake.robots.tiny import Tiny
from tests.world.meshes.files import RED_LEFT, UV, Glb, png

OLD = 10**9
SQUARE_OBJ = "v 0 0 0\nv .1 0 0\nv .1 .1 0\nv 0 .1 0\n"
TEXELS = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
MJCF = (
    '<mujoco>{}<worldbody><body name="a"><joint/><geom size="0.1"/>{}</body></worldbody></mujoco>'
)


class Probe(NamedTuple):
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

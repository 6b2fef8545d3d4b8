"""Reads the mesh file of an object as its vendor made it, and thins what is drawn.

Nothing outside its directory is opened, and sizes are checked first. Points of one grid cell become one; seams of a texture stay.
"""

import io
import json
import struct
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree
from trimesh.resolvers import FilePathResolver
from trimesh.visual import TextureVisuals

from pipeline.data.reading import read_regular
from pipeline.world.objects.from_files import ObjectError
from pipeline.world.objects.surface import finish
from pipeline.world.robots.meshes import thinned
from pipeline.world.shapes import Material, Parts

FORMATS = (".glb", ".gltf", ".obj", ".stl", ".ply", ".off")
LARGEST = 128 * 2**20  # bytes of a file
MAX_TRIANGLES = 500_000
MAX_PARTS = 200
MAX_PIXELS = 8192 * 8192
TEXTURE = 512  # pixels of a kept texture's longer edge at most
PLAIN = (0.8, 0.8, 0.8)

type Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one material: points (P,3), faces (M,3), texture coordinates (P,2), v down, where there is a texture."""

    points: Floats
    faces: NDArray[np.int64]
    material: Material
    uv: Floats | None = None

    def moved(self, matrix: Floats) -> "Part":
        """The same under a 4x4 matrix. A mirroring one turns the triangles, so that they still face outwards."""
        faces = self.faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else self.faces
        return replace(self, points=self.points @ matrix[:3, :3].T + matrix[:3, 3], faces=faces)


class _Inside(FilePathResolver):
    """Opens files below one directory only, and remembers why it refused others: some readers continue without them."""

    def __init__(self, source: str, within: Path) -> None:
        super().__init__(source)
        self.refused = ""
        self._within = within.resolve()

    def get(self, name: str) -> bytes:
        path = (Path(self.parent) / name.strip()).resolve()
        if not path.is_relative_to(self._within):
            return self._refuse(f"names {name!r}, which is outside its directory; open more with --within DIR")
        if path.is_file() and path.stat().st_size > LARGEST:
            return self._refuse(f"names {name!r}, which is larger than {LARGEST >> 20} MiB")
        try:
            _check_image(data := read_regular(path))
        except ValueError as error:
            return self._refuse(str(error))
        return data

    def _refuse(self, why: str) -> bytes:
        self.refused = self.refused or why
        raise ValueError(why)


def read_source(file: Path, within: Path | None = None) -> list[Part]:
    """The parts of a mesh file in its own frame and units. Textures are opened below `within` only, by default its directory.

    Raises ObjectError, one line that names the file.
    """
    kind = file.suffix.lower()
    if kind not in FORMATS:
        raise ObjectError(f"{file}: not one of {', '.join(FORMATS)}; convert it to .glb, .obj or .stl")
    try:
        if file.stat().st_size > LARGEST:
            raise ObjectError(f"{file}: is larger than {LARGEST >> 20} MiB; simplify it first")
        data = read_regular(file)
        if kind in (".glb", ".gltf"):
            _check_gltf(_document(data) if kind == ".glb" else json.loads(data), data)
        resolver = _Inside(str(file), within or file.parent)
        scene = trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], resolver=resolver, process=False)
        if resolver.refused:
            raise ValueError(resolver.refused)
        parts = [part for mesh in scene.dump() if (part := _part(mesh)) is not None]
    except ObjectError:
        raise
    except RecursionError as error:
        raise ObjectError(f"{file}: its nodes are nested too deeply, or in a circle") from error
    except Exception as error:  # whatever the readers of six formats make of a damaged file
        why = " ".join(f"{error}".split())[:160] or type(error).__name__
        raise ObjectError(f"{file}: not readable ({why})") from error
    _check(file, parts)
    return parts


def _check(file: Path, parts: list[Part]) -> None:
    faces = sum(len(part.faces) for part in parts)
    if not faces:
        raise ObjectError(f"{file}: holds no triangles")
    if faces > MAX_TRIANGLES or len(parts) > MAX_PARTS:
        raise ObjectError(
            f"{file}: has {faces} triangles in {len(parts)} parts; {MAX_TRIANGLES} in {MAX_PARTS} at most, simplify it first"
        )
    for part in parts:
        if not np.isfinite(part.points).all():
            raise ObjectError(f"{file}: has a vertex that is not finite")
        if part.faces.min() < 0 or part.faces.max() >= len(part.points):
            raise ObjectError(f"{file}: has a triangle of vertices that it does not hold")


def _document(data: bytes) -> Any:
    magic, _, _, length, kind = struct.unpack("<5I", data[:20])
    if magic != 0x46546C67 or kind != 0x4E4F534A or length > len(data) - 20:
        raise ValueError("no header of a binary glTF file")
    return json.loads(data[20 : 20 + length])


def _check_image(data: bytes) -> None:
    """Raise ValueError for an image that unpacks to more than is read; data that is no image passes."""
    if not data.startswith((b"\x89PNG", b"\xff\xd8", b"RIFF", b"GIF8", b"BM", b"II*", b"MM")):
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        width, height = Image.open(io.BytesIO(data)).size
    if width * height > MAX_PIXELS:
        raise ValueError(f"has a texture of {width} x {height} pixels; make it smaller")


def _check_gltf(document: Any, data: bytes) -> None:
    """Raise ValueError for nodes in a circle, and for more triangles or pixels than are read, before memory is taken for them."""
    for view in (document["bufferViews"][image["bufferView"]] for image in document.get("images", []) if "bufferView" in image):
        start = 28 + struct.unpack("<I", data[12:16])[0] + view.get("byteOffset", 0)
        _check_image(data[start : start + view["byteLength"]])
    nodes = document.get("nodes", [])
    parents = [child for node in nodes for child in node.get("children", [])]
    roots = set(range(len(nodes))) - set(parents)
    if len(parents) != len(set(parents)) or (nodes and not roots):
        raise ValueError("a node has two parents, or the nodes form a circle")
    reached, todo = set[int](), list(roots)
    while todo:
        node = todo.pop()
        reached.add(node)
        todo += nodes[node].get("children", [])
    if len(reached) < len(nodes):
        raise ValueError("its nodes form a circle")
    accessors = document.get("accessors", [])
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            count = accessors[primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]
            if count > 3 * MAX_TRIANGLES:
                raise ValueError(f"has {count // 3} triangles; {MAX_TRIANGLES} at most, simplify it first")


def _part(mesh: Any) -> Part | None:
    """A part of a loaded geometry; None for lines and points."""
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        return None
    points, faces = np.array(mesh.vertices, float), np.array(mesh.faces, np.int64)
    look, image, uv = mesh.visual, None, None
    if isinstance(look, TextureVisuals) and look.uv is not None and len(look.uv) == len(points):
        material = look.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        uv = np.array(look.uv, float) * [1, -1] + [0, 1]
    color = getattr(look, "main_color", None)
    if isinstance(look, TextureVisuals):
        color = getattr(look.material, "main_color", None)
    r, g, b = PLAIN if color is None else (np.asarray(color, float)[:3] / 255).tolist()
    if image is None or uv is None or not np.isfinite(uv).all():
        return Part(points, faces, Material((r, g, b)))
    return Part(points, faces, Material((r, g, b), texture=_pixels(image)), uv)


def _pixels(image: Any) -> NDArray[np.uint8]:
    """The image (H,W,4), not larger than is kept."""
    width, height = image.size
    scale = min(1.0, TEXTURE / max(width, height))
    small = image.convert("RGBA")
    if scale < 1:
        small = small.resize((max(1, round(width * scale)), max(1, round(height * scale))))
    return np.array(small, np.uint8)


TRIANGLES = 2000  # of an object at most
CREASE = 40.0


def drawn_parts(parts: list[Part]) -> Parts:
    """Meshes and materials of an object's parts (m, its own frame), TRIANGLES in all at most."""
    total = sum(len(part.faces) for part in parts)
    return tuple((_mesh(part, max(20, TRIANGLES * len(part.faces) // total)), part.material) for part in parts)


def _mesh(part: Part, budget: int):
    points, faces = part.points, part.faces
    if part.uv is None:
        if len(faces) > budget:
            points, faces = thinned(points, faces, budget)
        return finish(points, faces, crease=CREASE)
    if len(faces) <= budget:
        return finish(points, faces, part.uv[faces], CREASE)
    thin_points, thin_faces = thinned(points, faces, budget)
    return finish(thin_points, thin_faces, _carry_over(part, thin_points[thin_faces]), CREASE)


def _carry_over(part: Part, corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Texture coordinates (M,3,2) of new triangles (M,3,3): those of the old triangle nearest to each one's middle, continued
    over its plane, so that no triangle reaches over a seam of the texture."""
    old = part.points[part.faces]
    a, edges = old[:, 0], old[:, 1:] - old[:, :1]
    nearest = np.asarray(KDTree(old.mean(1)).query(corners.mean(1))[1])
    basis, origin, uv = edges[nearest], a[nearest], part.uv[part.faces][nearest]  # pyright: ignore[reportOptionalSubscript]
    gram = np.einsum("nij,nkj->nik", basis, basis) + 1e-18 * np.eye(2)
    right = np.einsum("nij,ncj->nci", basis, corners - origin[:, None])
    weights = np.clip(np.linalg.solve(gram[:, None], right[..., None])[..., 0], -3, 4)
    return uv[:, :1] + np.einsum("nci,nij->ncj", weights, uv[:, 1:] - uv[:, :1])


def welded(parts: list[Part]) -> trimesh.Trimesh:
    """One mesh of all parts, its seams closed."""
    offsets = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, offsets, strict=True)])
    mesh = trimesh.Trimesh(np.concatenate([part.points for part in parts]), faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return mesh

"""Reads mesh files of seven formats as parts, and makes of them what collides and what is drawn."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.data.errors import DominoError
from pipeline.world.meshes.dae import read_dae
from pipeline.world.meshes.files import MAX_TRIANGLES, read_bytes
from pipeline.world.meshes.gltf import read_gltf
from pipeline.world.meshes.obj import read_obj
from pipeline.world.meshes.part import MeshError, MeshFile, MeshLook, Part, joined, painted

READERS = {".glb": read_gltf, ".gltf": read_gltf, ".obj": read_obj, ".dae": read_dae}
BARE = (".stl", ".ply", ".off")
FORMATS = (*READERS, *BARE)
MAX_PARTS = 200


def read_mesh(file: Path, within: Path | None = None) -> MeshFile:
    """The parts of a mesh file, one a look, in its own frame and units. Files that it names are
    opened below the folder `within` only, by default its own. Raises MeshError, one line that
    names the file."""
    kind = file.suffix.lower()
    if kind not in FORMATS:
        raise MeshError(
            f"{file}: not one of {', '.join(FORMATS)}; convert it to .stl, .obj or .glb"
        )
    try:
        read = READERS.get(kind, _read_bare)(file, within or file.parent)
        mesh = read._replace(parts=joined(read.parts))
        _check(mesh.parts)
    except DominoError as error:
        raise MeshError(
            str(error) if str(error).startswith(f"{file}: ") else f"{file}: {error}"
        ) from error
    except RecursionError as error:
        raise MeshError(f"{file}: its parts are nested too deeply") from error
    except Exception as error:  # whatever a damaged file leads its reader to
        why = " ".join(f"{error}".split())[:160] or type(error).__name__
        raise MeshError(
            f"{file}: not readable ({why}); convert it to .stl, .obj or .glb"
        ) from error
    return mesh


def _read_bare(file: Path, within: Path) -> MeshFile:
    """STL, PLY and OFF, which name no other file."""
    import io

    import trimesh

    kind = file.suffix.lower()[1:]
    mesh = trimesh.load(io.BytesIO(read_bytes(file)), file_type=kind, force="mesh", process=False)
    if not isinstance(mesh, trimesh.Trimesh):
        raise MeshError("holds no triangles")
    part = Part(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))
    visual: Any = mesh.visual
    if visual.kind == "vertex" and len(visual.vertex_colors) == len(part.points):
        part = painted(part, np.asarray(visual.vertex_colors, float)[:, :3] / 255)
    elif visual.kind == "face" and len(visual.face_colors) == len(part.faces):
        corners = part.points[part.faces].reshape(-1, 3)
        shades = np.repeat(np.asarray(visual.face_colors, float)[:, :3] / 255, 3, axis=0)
        part = painted(Part(corners, np.arange(len(corners)).reshape(-1, 3), MeshLook()), shades)
    return MeshFile((part,))


def _check(parts: tuple[Part, ...]) -> None:
    faces = sum(len(part.faces) for part in parts)
    if not faces:
        raise MeshError("holds no triangles")
    if faces > MAX_TRIANGLES or len(parts) > MAX_PARTS:
        raise MeshError(
            f"has {faces} triangles in {len(parts)} materials; {MAX_TRIANGLES} in {MAX_PARTS} at"
            " most, simplify it first"
        )
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.points):
            raise MeshError("has a triangle of vertices that it does not hold")
        if not np.isfinite(part.points[part.faces]).all():
            raise MeshError("has a vertex that is not finite")
        if part.uv is not None and not np.isfinite(part.uv).all():
            raise MeshError("has a texture coordinate that is not finite")

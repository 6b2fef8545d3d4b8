"""Mesh files of seven formats, and what is drawn and what is solid."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import KDTree

from pipeline.data.errors import DominoError
from pipeline.poses import Floats, Ints
from pipeline.world.objects.surface import area_vectors, finish
from pipeline.world.shapes import Material, Mesh, Parts

from .dae import read_dae
from .files import MAX_TRIANGLES, read_bytes
from .gltf import read_gltf
from .obj import read_obj
from .part import MeshError, MeshFile, Part, joined, painted, stacked

PLAIN = (0.8, 0.8, 0.8)
CREASE = 40.0


def drawn(parts: Sequence[Part], budget: int, fewest: int) -> Parts:
    """Meshes and materials, about `budget` triangles in all and `fewest` a part."""
    total = max(1, sum(len(part.faces) for part in parts))
    looks = (Material(part.look.color or PLAIN, texture=part.look.texture) for part in parts)
    shares = (max(fewest, budget * len(part.faces) // total) for part in parts)
    return tuple(zip(map(_mesh, parts, shares), looks, strict=True))


def _mesh(part: Part, budget: int) -> Mesh:
    points, faces = part.points, part.faces
    uv = None if part.uv is None else part.uv[faces]
    if len(faces) > budget:
        points, faces = thinned(points, faces, budget)
        uv = None if uv is None else _carry_over(part.points[part.faces], uv, points[faces])
    return finish(points, faces, uv, CREASE)


def _carry_over(old: Floats, uv: Floats, corners: Floats) -> Floats:
    """Texture coordinates (M,3,2) of new triangles (M,3,3): those of the nearest old one, continued
    over its plane, so that none reaches over a seam."""
    a, edges = old[:, 0], old[:, 1:] - old[:, :1]
    nearest = np.asarray(KDTree(old.mean(1)).query(corners.mean(1))[1])
    basis, origin, texels = edges[nearest], a[nearest], uv[nearest]
    gram = np.einsum("nij,nkj->nik", basis, basis) + 1e-18 * np.eye(2)
    right = np.einsum("nij,ncj->nci", basis, corners - origin[:, None])
    weights = np.clip(np.linalg.solve(gram[:, None], right[..., None])[..., 0], -3, 4)
    return texels[:, :1] + np.einsum("nci,nij->ncj", weights, texels[:, 1:] - texels[:, :1])


def welded(parts: Sequence[Part]) -> tuple[Floats, Ints]:
    """All parts as one mesh, points (P,3), faces (M,3), without seams."""
    mesh = trimesh.Trimesh(*stacked(parts), process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def thinned(points: Floats, faces: Ints, budget: int) -> tuple[Floats, Ints]:
    """Points (P,3) m and faces (M,3), snapped to means of the finest grid with `budget` faces."""
    facing = area_vectors(points, faces)
    area = float(np.linalg.norm(facing, axis=1).sum()) / 2
    # cells of this size leave about 3 faces per budgeted one: a start on the fine side
    cell = 0.8 * np.sqrt(area / budget)
    kept, thin = points, faces
    while len(thin) > budget:
        cells = np.floor((points - points.min(0)) / cell).astype(np.int64)
        _, group = np.unique(_packed(cells), return_inverse=True)
        count = np.bincount(group)
        kept = np.stack([np.bincount(group, points[:, k]) for k in range(3)], 1) / count[:, None]
        thin = group[faces]
        # collapsed and folded-over faces go
        thin = thin[np.einsum("ij,ij->i", area_vectors(kept, thin), facing) > 0]
        # two faces on the same three cells are one face seen twice
        thin = thin[np.unique(_packed(np.sort(thin, axis=1)), return_index=True)[1]]
        cell *= 1.15
    return kept, thin


def _packed(rows: Ints) -> Ints:
    return (rows[:, 0] << 42) | (rows[:, 1] << 21) | rows[:, 2]


READERS = {".glb": read_gltf, ".gltf": read_gltf, ".obj": read_obj, ".dae": read_dae}
BARE = (".stl", ".ply", ".off")
FORMATS = (*READERS, *BARE)
MAX_PARTS = 200


def read_mesh(file: Path, within: Path | None = None) -> MeshFile:
    """Parts in the file's own frame and units. Files that it names lie below `within`, by default
    its folder. Raises MeshError, one line that names the file."""
    kind = file.suffix.lower()
    fix = "convert it to .stl, .obj or .glb"
    if kind not in FORMATS:
        raise MeshError(f"{file}: not one of {', '.join(FORMATS)}; {fix}")
    try:
        read = READERS.get(kind, _read_bare)(file, within or file.parent)
        mesh = read._replace(parts=joined(read.parts))
        _check(mesh.parts)
    except DominoError as error:
        raise MeshError(f"{file}: {str(error).removeprefix(f'{file}: ')}") from error
    except Exception as error:  # whatever a damaged file leads its reader to
        why = " ".join(f"{error}".split())[:160] or type(error).__name__
        raise MeshError(f"{file}: not readable ({why}); {fix}") from error
    return mesh


def _read_bare(file: Path, within: Path) -> MeshFile:
    """STL, PLY and OFF, which name no other file."""
    kind = file.suffix.lower()[1:]
    mesh = trimesh.load(io.BytesIO(read_bytes(file)), file_type=kind, force="mesh", process=False)
    if not isinstance(mesh, trimesh.Trimesh):
        raise MeshError("holds no triangles")
    part = Part(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))
    visual: Any = mesh.visual
    if visual.kind == "vertex" and len(visual.vertex_colors) == len(part.points):
        part = painted(part, np.asarray(visual.vertex_colors, float)[:, :3] / 255)
    return MeshFile((part,))


def _check(parts: tuple[Part, ...]) -> None:
    faces = sum(len(part.faces) for part in parts)
    if not faces:
        raise MeshError("holds no triangles")
    if faces > MAX_TRIANGLES or len(parts) > MAX_PARTS:
        what = f"has {faces} triangles in {len(parts)} materials"
        raise MeshError(f"{what}; {MAX_TRIANGLES} in {MAX_PARTS} at most, simplify it first")
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.points):
            raise MeshError("has a triangle of vertices that it does not hold")
        if not np.isfinite(part.points[part.faces]).all():
            raise MeshError("has a vertex that is not finite")
        if part.uv is not None and not np.isfinite(part.uv).all():
            raise MeshError("has a texture coordinate that is not finite")

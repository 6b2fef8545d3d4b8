"""Fewer triangles for what is drawn, with its texture: points of one grid cell become one, seams of the texture stay."""

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.run.objects.source import Part
from pipeline.world.objects.surface import finish
from pipeline.world.robots.meshes import thinned
from pipeline.world.shapes import Parts

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
    nearest = _nearest(old.mean(1), corners.mean(1))
    basis, origin, uv = edges[nearest], a[nearest], part.uv[part.faces][nearest]  # pyright: ignore[reportOptionalSubscript]
    gram = np.einsum("nij,nkj->nik", basis, basis) + 1e-18 * np.eye(2)
    right = np.einsum("nij,ncj->nci", basis, corners - origin[:, None])
    weights = np.clip(np.linalg.solve(gram[:, None], right[..., None])[..., 0], -3, 4)
    return uv[:, :1] + np.einsum("nci,nij->ncj", weights, uv[:, 1:] - uv[:, :1])


def _nearest(known: NDArray[np.float64], asked: NDArray[np.float64]) -> NDArray[np.int64]:
    from scipy.spatial import KDTree

    return np.asarray(KDTree(known).query(asked)[1])


def welded(parts: list[Part]) -> trimesh.Trimesh:
    """One mesh of all parts, its seams closed."""
    offsets = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, offsets, strict=True)])
    mesh = trimesh.Trimesh(np.concatenate([part.points for part in parts]), faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return mesh

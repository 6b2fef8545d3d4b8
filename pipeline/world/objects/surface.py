"""From triangles to a `Mesh`. Corner uvs are (M,3,2); u right, v down, as in images."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.poses import Floats
from pipeline.world.shapes import Mesh, deferred, merge

WELD = 1e-6  # m: points closer than this are one point


@deferred
def finish(
    points: ArrayLike, faces: ArrayLike, uv: ArrayLike | None = None, crease: float = 40.0
) -> Mesh:
    """Mesh of points (P,3) m and outward faces (M,3). A corner's normal is the area-weighted mean
    of faces around it within `crease` degrees. Faces without area are dropped."""
    points, faces = np.asarray(points, float), np.asarray(faces, int).reshape(-1, 3)
    keys, point_of = np.unique(np.rint(points / WELD).astype(np.int64), axis=0, return_inverse=True)
    welded = np.zeros((len(keys), 3))
    welded[point_of.ravel()] = points
    faces = point_of.ravel()[faces]
    area_normal = area_vectors(welded, faces)
    size = np.linalg.norm(area_normal, axis=1)
    keep = size > 1e-12
    faces, area_normal, size = faces[keep], area_normal[keep], size[keep]
    unit = area_normal / size[:, None]
    normals = _corner_normals(faces, area_normal, unit, np.cos(np.radians(crease)))
    corners = faces.ravel()
    columns = [corners[:, None], np.rint(normals * 2e3).astype(np.int64)]
    corner_uv = None
    if uv is not None:
        corner_uv = np.asarray(uv, float)[keep].reshape(-1, 2)
        columns.append(np.rint(corner_uv * 1e5).astype(np.int64))
    _, first, index = np.unique(
        np.concatenate(columns, axis=1), axis=0, return_index=True, return_inverse=True
    )
    return Mesh(
        welded[corners[first]].astype(np.float32),
        index.reshape(-1, 3).astype(np.uint32),
        normals[first].astype(np.float32),
        None if corner_uv is None else corner_uv[first].astype(np.float32),
    )


def area_vectors(points: Floats, faces: NDArray) -> Floats:
    """Outward normals (M,3) of faces (M,3), twice the face's area long."""
    a, b, c = points[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def _corner_normals(
    faces: NDArray, area_normal: NDArray, unit: NDArray, threshold: float
) -> Floats:
    corner = np.argsort(faces.ravel(), kind="stable")
    _, counts = np.unique(faces.ravel(), return_counts=True)
    repeats = np.repeat(counts, counts)
    left = np.repeat(corner, repeats)
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    within = np.arange(len(left)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    right = corner[np.repeat(starts, repeats) + within]
    smooth = np.einsum("ij,ij->i", unit[left // 3], unit[right // 3]) >= threshold - 1e-9
    total = np.zeros((faces.size, 3))
    for axis in range(3):
        weights = area_normal[right[smooth] // 3, axis]
        total[:, axis] = np.bincount(left[smooth], weights=weights, minlength=faces.size)
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def box_uv(points: ArrayLike, faces: ArrayLike) -> Floats:
    """Corner uvs (M,3,2), projected along each face's dominant axis; the bounding box fills the
    unit square."""
    points, faces = np.asarray(points, float), np.asarray(faces, int)
    lower = points.min(0)
    unit = (points - lower) / np.maximum(np.ptp(points, axis=0), 1e-9)
    normal = area_vectors(points, faces)
    axis = np.argmax(np.abs(normal) * [1.0, 1.0, 1.001], axis=1)
    positive = np.take_along_axis(normal, axis[:, None], 1)[:, 0] > 0
    across = np.array([1, 0, 0])[axis]
    up = np.array([2, 2, 1])[axis]
    corners = unit[faces]
    u = np.take_along_axis(corners, across[:, None, None], 2)[..., 0]
    v = np.take_along_axis(corners, up[:, None, None], 2)[..., 0]
    # seen from outside, +x, -y and +z faces read left to right
    mirrored = np.where(axis == 1, positive, ~positive)
    return np.stack([np.where(mirrored[:, None], 1 - u, u), 1 - v], axis=-1)


@deferred
def join(*meshes: Mesh) -> Mesh:
    """One mesh of several; uvs survive only if all have them."""
    bare = any(m.uvs is None for m in meshes)
    return merge([Mesh(m.vertices, m.triangles, m.normals, None) if bare else m for m in meshes])

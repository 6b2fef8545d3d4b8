"""What of the parts of a mesh file is drawn and what is solid: few triangles with their looks, and
one closed mesh."""

from collections.abc import Sequence

import numpy as np
import trimesh
from scipy.spatial import KDTree

from pipeline.world.meshes.part import Color, Floats, Ints, Part, stacked
from pipeline.world.objects.surface import finish
from pipeline.world.shapes import Material, Mesh, Parts

PLAIN = (0.8, 0.8, 0.8)
CREASE = 40.0


def drawn(parts: Sequence[Part], budget: int, fewest: int, plain: Color = PLAIN) -> Parts:
    """Meshes and materials of parts (m), of about `budget` triangles in all and `fewest` a part.
    Parts whose file states no color are `plain`."""
    total = max(1, sum(len(part.faces) for part in parts))
    return tuple(
        (
            _mesh(part, max(fewest, budget * len(part.faces) // total)),
            Material(part.look.color or plain, texture=part.look.texture),
        )
        for part in parts
    )


def _mesh(part: Part, budget: int) -> Mesh:
    points, faces, uv = part.points, part.faces, part.uv
    if len(faces) > budget:
        points, faces = thinned(points, faces, budget)
    if uv is None:
        return finish(points, faces, crease=CREASE)
    if faces is part.faces:
        return finish(points, faces, uv[faces], CREASE)
    return finish(
        points, faces, _carry_over(part.points[part.faces], uv[part.faces], points[faces]), CREASE
    )


def _carry_over(old: Floats, uv: Floats, corners: Floats) -> Floats:
    """Texture coordinates (M,3,2) of new triangles (M,3,3), from old ones (N,3,3) with theirs
    (N,3,2): those of the old triangle nearest to each one's middle, continued over its plane, so
    that no triangle reaches over a seam."""
    a, edges = old[:, 0], old[:, 1:] - old[:, :1]
    nearest = np.asarray(KDTree(old.mean(1)).query(corners.mean(1))[1])
    basis, origin, texels = edges[nearest], a[nearest], uv[nearest]
    gram = np.einsum("nij,nkj->nik", basis, basis) + 1e-18 * np.eye(2)
    right = np.einsum("nij,ncj->nci", basis, corners - origin[:, None])
    weights = np.clip(np.linalg.solve(gram[:, None], right[..., None])[..., 0], -3, 4)
    return texels[:, :1] + np.einsum("nci,nij->ncj", weights, texels[:, 1:] - texels[:, :1])


def welded(parts: Sequence[Part]) -> tuple[Floats, Ints]:
    """Points (P,3) and faces (M,3) of all parts as one mesh, its seams closed."""
    mesh = trimesh.Trimesh(*stacked(parts), process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def thinned(points: Floats, faces: Ints, budget: int) -> tuple[Floats, Ints]:
    """Points (P,3) m and faces (M,3), snapped to the means of the finest grid cells that leave
    `budget` faces."""
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


def area_vectors(points: Floats, faces: Ints) -> Floats:
    """Outward normals (M,3) with the length of twice the face's area."""
    a, b, c = points[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def _packed(rows: Ints) -> Ints:
    """One integer per row (N,3) of numbers from 0 to 2^21."""
    return (rows[:, 0] << 42) | (rows[:, 1] << 21) | rows[:, 2]

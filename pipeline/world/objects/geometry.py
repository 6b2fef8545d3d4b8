"""Parametric surfaces with uvs and few triangles (m, z up). Boxes, spheres and capsules are
centred; revolved and extruded ones keep their z values."""

from collections.abc import Sequence

import numpy as np
from manifold3d import triangulate
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

from pipeline.poses import Floats, pose, quat_about, quat_multiply
from pipeline.world.shapes import Mesh, deferred, quads

from .surface import area_vectors, box_uv, finish


def at(mesh: Mesh, position: ArrayLike = (0, 0, 0), quaternion: ArrayLike = (1, 0, 0, 0)) -> Mesh:
    """Turn by `quaternion` (4,) wxyz, then move to `position` (3,) m."""
    return mesh.moved(pose(position, quaternion))


@deferred
def scaled(mesh: Mesh, x: float, y: float, z: float) -> Mesh:
    factors = np.array([x, y, z], np.float32)
    normals = mesh.normals / factors
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(mesh.vertices * factors, mesh.triangles, normals, mesh.uvs)


@deferred
def revolve(profile: ArrayLike, sides: int = 24, crease: float = 40.0) -> Mesh:
    """Revolve `profile` (K,2) of (radius, z) about z, material on its left. u goes round, v falls
    along the profile from 1 to 0."""
    profile = np.asarray(profile, float)
    radius, z = profile.T
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    v = 1 - length / length[-1]
    angle = 2 * np.pi * np.arange(sides) / sides
    x, y = np.outer(np.cos(angle), radius), np.outer(np.sin(angle), radius)
    points, k = np.stack([x, y, np.tile(z, (sides, 1))], -1), len(profile)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(sides), np.arange(k - 1), indexing="ij"))
    n = (i + 1) % sides
    faces = quads(i * k + j, n * k + j, n * k + j + 1, i * k + j + 1)
    uvs = _quad_uvs(i / sides, (i + 1) / sides, v[j], v[j + 1])
    return finish(points.reshape(-1, 3), faces, np.concatenate(uvs), crease)


def _quad_uvs(u0: NDArray, u1: NDArray, v0: NDArray, v1: NDArray) -> list[Floats]:
    a, b, c, d = (np.stack(uv, 1) for uv in ((u0, v0), (u1, v0), (u1, v1), (u0, v1)))
    return [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]


def tapered(foot: float, rim: float, height: float, wall: float, sides: int) -> tuple[Mesh, Mesh]:
    edge = (rim - wall, height)
    outside = revolve([(0, 0), (foot, 0), (rim, height), edge], sides)
    return outside, revolve([edge, (foot - wall, wall), (0, wall)], sides)


@deferred
def band(radius: float, lower: float, upper: float) -> Mesh:
    """A label round a cylinder between two heights (m): three images, one faces -y."""
    sides, prints = 24, 3
    angle = -np.pi / 2 - np.pi / prints + 2 * np.pi * np.arange(sides + 1) / sides
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
    rings = [np.column_stack([ring, np.full(sides + 1, z)]) for z in (lower, upper)]
    points, i = np.concatenate(rings), np.arange(sides)
    faces = quads(i, i + 1, i + sides + 2, i + sides + 1)
    u = np.linspace(0, prints, sides + 1)
    uv = np.column_stack([np.tile(u, 2), np.repeat([1.0, 0.0], sides + 1)])
    return finish(points, faces, uv[faces], 60.0)


@deferred
def decal(
    width: float,
    height: float,
    position: ArrayLike = (0, 0, 0),
    quaternion: ArrayLike = (1, 0, 0, 0),
) -> Mesh:
    """A rectangle in local xy facing +z, image upright along +y."""
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * [width / 2, height / 2, 1]
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return at(finish(points, faces, uv[faces]), position, quaternion)


def upright(turns: float) -> Floats:
    """Quaternion of an upright decal facing -y, turned by quarters about z."""
    return quat_multiply(quat_about((0, 0, 1), turns * np.pi / 2), quat_about((1, 0, 0), np.pi / 2))


@deferred
def box(hx: float, hy: float, hz: float, bevel: float = 0.0) -> Mesh:
    """Box of half extents with chamfers of `bevel` (m); uv per side."""
    half = np.array([hx, hy, hz])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    if bevel <= 0:
        points = signs * half
    else:
        inset = np.minimum(half - 1e-5, half - bevel)
        points = np.concatenate(
            [signs * np.where(np.arange(3) == axis, half, inset) for axis in range(3)]
        )
    faces = hull_faces(points)
    return finish(points, faces, box_uv(points, faces), 50.0)


def hull_faces(points: NDArray) -> NDArray[np.integer]:
    """Outward hull triangles (M,3) of `points` (N,3)."""
    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    inward = np.einsum("ij,ij->i", area_vectors(points, faces), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return faces


@deferred
def cylinder(radius: float, height: float, sides: int = 24, bevel: float = 0.0) -> Mesh:
    r, h, b = radius, height, bevel
    if b <= 0:
        return revolve([(0, 0), (r, 0), (r, h), (0, h)], sides)
    return revolve([(0, 0), (r - b, 0), (r, b), (r, h - b), (r - b, h), (0, h)], sides, 50.0)


def arc(
    centre: Sequence[float], radius: float, start: float, end: float, n: int
) -> list[tuple[float, float]]:
    """Points of a circle (m): `n` + 1 pairs between two angles in degrees."""
    angle = np.radians(np.linspace(start, end, n + 1))
    x, y = centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)
    return list(zip(x.tolist(), y.tolist(), strict=True))


def sphere(radius: float, rings: int = 8, sides: int = 16) -> Mesh:
    return capsule(radius, 0.0, rings, sides)


@deferred
def capsule(radius: float, half: float, rings: int = 6, sides: int = 12) -> Mesh:
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    z = radius * np.sin(angle) + half * np.sign(np.round(angle, 9))
    profile = np.column_stack([radius * np.cos(angle), z])
    profile[[0, -1], 0] = 0
    return revolve(profile, sides, 60.0)


@deferred
def loft(sections: ArrayLike, caps: bool = True, crease: float = 40.0) -> Mesh:
    """Skin through `sections` (S,K,3): closed rings, counter-clockwise against the direction of
    travel. u goes round, v runs from 1 to 0."""
    sections = np.asarray(sections, float)
    s, k, _ = sections.shape
    points = sections.reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(s - 1), np.arange(k), indexing="ij"))
    n = (j + 1) % k
    faces = [quads(i * k + j, i * k + n, (i + 1) * k + n, (i + 1) * k + j)]
    uvs = _quad_uvs(j / k, (j + 1) / k, 1 - i / (s - 1), 1 - (i + 1) / (s - 1))
    if caps:
        ring = np.arange(k)
        for index, reverse in ((0, True), (s - 1, False)):
            points = np.concatenate([points, sections[index].mean(0, keepdims=True)])
            middle, first = np.full(k, len(points) - 1), index * k
            fan = np.stack([middle, first + ring, first + (ring + 1) % k], 1)
            faces.append(fan[:, ::-1] if reverse else fan)
            turn = 2 * np.pi * np.stack([np.zeros(k), ring, ring + 1], 1) / k
            disc = 0.5 + 0.5 * np.stack([np.cos(turn), np.sin(turn)], -1)
            disc[:, 0] = 0.5
            uvs.append(disc[:, ::-1] if reverse else disc)
    return finish(points, np.concatenate(faces), np.concatenate(uvs), crease)


@deferred
def sweep(path: ArrayLike, radius: ArrayLike, sides: int = 8, closed: bool = False) -> Mesh:
    """Round tube of `radius` (m; one or per point) along `path` (N,3), unless `closed` with
    ends."""
    path = np.asarray(path, float)
    radius = np.broadcast_to(np.asarray(radius, float), len(path))
    ahead = np.roll(path, -1, 0) - path
    behind = path - np.roll(path, 1, 0)
    if not closed:
        ahead[-1], behind[0] = behind[-1], ahead[0]
    unit_ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    unit_behind = behind / np.linalg.norm(behind, axis=1, keepdims=True)
    tangent = unit_ahead + unit_behind
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = _transported(tangent)
    if closed:
        path, radius, tangent = (np.concatenate([a, a[:1]]) for a in (path, radius, tangent))
        side = np.concatenate([side, side[:1]])
    angle = 2 * np.pi * np.arange(sides)[:, None] / sides
    up = np.cross(tangent, side)
    ring = np.cos(angle) * side[:, None] + np.sin(angle) * up[:, None]
    return loft(path[:, None] + radius[:, None, None] * ring, caps=not closed, crease=60.0)


def _transported(tangent: NDArray) -> Floats:
    start = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    sides = []
    for t in tangent:
        start = start - t * (start @ t)
        start = start / np.linalg.norm(start)
        sides.append(start)
    return np.array(sides)


@deferred
def extrude(outline: ArrayLike, height: float, bevel: float = 0.0, crease: float = 35.0) -> Mesh:
    """Prism from z = 0 over `outline` (K,2), counter-clockwise, possibly concave."""
    outline = np.asarray(outline, float)
    k = len(outline)
    if bevel > 0:
        inner = inset(outline, bevel)
        rings = [(inner, 0.0), (outline, bevel), (outline, height - bevel), (inner, height)]
    else:
        rings = [(outline, 0.0), (outline, height)]
    points = np.concatenate([np.column_stack([ring, np.full(k, z)]) for ring, z in rings])
    j = np.arange(k)
    n = (j + 1) % k
    starts = k * np.arange(len(rings) - 1)
    walls = [quads(s + j, s + n, s + k + n, s + k + j) for s in starts]
    lid = np.asarray(triangulate([rings[0][0].tolist()]), int)
    faces = np.concatenate([*walls, lid[:, ::-1], lid + (len(rings) - 1) * k])
    return finish(points, faces, box_uv(points, faces), crease)


def inset(outline: ArrayLike, distance: float) -> Floats:
    """Move the sides of an `outline` (K,2), counter-clockwise, inwards by `distance` (m); mitres
    are at most twice as long."""
    outline = np.asarray(outline, float)
    edge = np.roll(outline, -1, 0) - outline
    normal = np.stack([-edge[:, 1], edge[:, 0]], 1) / np.linalg.norm(edge, axis=1, keepdims=True)
    mitre = normal + np.roll(normal, 1, 0)
    mitre /= np.linalg.norm(mitre, axis=1, keepdims=True)
    stretch = 1 / np.maximum(np.einsum("ij,ij->i", mitre, normal), 0.5)
    return outline + mitre * (distance * stretch)[:, None]


def rounded_rectangle(hx: float, hy: float, radius: float, n: int = 4) -> Floats:
    """Counter-clockwise outline (4(n+1),2) of a rectangle of half extents."""
    r = min(radius, hx, hy)
    x, y = hx - r, hy - r
    corners = ((x, y), 0), ((-x, y), 90), ((-x, -y), 180), ((x, -y), 270)
    return np.array([p for centre, start in corners for p in arc(centre, r, start, start + 90, n)])


def ellipse(a: float, b: float, n: int = 24) -> Floats:
    angle = 2 * np.pi * np.arange(n) / n
    return np.column_stack([a * np.cos(angle), b * np.sin(angle)])


def side_prism(outline: ArrayLike, half: float, bevel: float = 0.0, crease: float = 35.0) -> Mesh:
    """Prism over an outline (K,2) of (x, z), counter-clockwise from -y, between y = -`half` and
    `half`."""
    return at(
        extrude(outline, 2 * half, bevel, crease), (0, half, 0), quat_about((1, 0, 0), np.pi / 2)
    )


def stacked(outline: ArrayLike, levels: ArrayLike) -> Floats:
    """Rings (L,K,3): outline (K,2) by level (z, scale x, scale y)."""
    outline, levels = np.asarray(outline, float), np.asarray(levels, float)
    rings = outline[None] * levels[:, None, 1:]
    z = np.broadcast_to(levels[:, None, :1], (*rings.shape[:2], 1))
    return np.concatenate([rings, z], axis=-1)


@deferred
def stack(outline: ArrayLike, levels: ArrayLike, crease: float = 50.0) -> Mesh:
    return loft(stacked(outline, levels), crease=crease)

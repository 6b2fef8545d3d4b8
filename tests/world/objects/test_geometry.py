"""Surfaces and colliders against closed forms: volumes, closedness, normals, uv directions."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.poses import transform
from pipeline.world.objects import colliders, geometry
from pipeline.world.objects.surface import finish, join
from pipeline.world.shapes import Mesh

LENGTH = st.floats(0.01, 0.3)


def polygon_area(radius: float, n: int) -> float:
    return n / 2 * radius**2 * np.sin(2 * np.pi / n)


def volume(mesh: Mesh) -> float:
    a, b, c = mesh.vertices.astype(float)[mesh.triangles].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def closed(mesh: Mesh) -> bool:
    return trimesh.Trimesh(mesh.vertices, mesh.triangles).is_watertight


L = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]) * 0.1
TURN = 2 * np.pi * np.arange(32) / 32
RING = 0.1 * np.column_stack([np.cos(TURN), np.sin(TURN), 0 * TURN])

SQUARE = ((1, 1), (-1, 1), (-1, -1), (1, -1))
SOLIDS = {
    "cylinder": (geometry.cylinder(0.1, 0.3, 24), polygon_area(0.1, 24) * 0.3),
    "hollow": (geometry.revolve([(0, 0), (0.1, 0), (0.1, 0.2), (0.09, 0.2), (0.09, 0.01), (0, 0.01)], 16),  # noqa: E501
               polygon_area(0.1, 16) * 0.2 - polygon_area(0.09, 16) * 0.19),
    "box": (geometry.box(0.1, 0.2, 0.3), 0.048),
    "L prism": (geometry.extrude(L, 0.5), 0.03 * 0.5),
    "sphere": (geometry.sphere(0.1, 24, 48), 4 / 3 * np.pi * 0.001),
    "capsule": (geometry.capsule(0.1, 0.2, 24, 48), np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 0.001),
    "torus": (geometry.sweep(RING, 0.02, 16, closed=True), 2 * np.pi * 0.1 * np.pi * 0.02**2),
    "tube": (geometry.sweep([(0, 0, 0), (0, 0, 0.2)], 0.02, 12), polygon_area(0.02, 12) * 0.2),
    "frustum": (geometry.loft([[(x * s, y * s, z) for x, y in SQUARE] for s, z in ((1, 0), (0.5, 1))]), (4 + 1 + 2) / 3),  # noqa: E501
}  # fmt: skip


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_have_their_volume(name):
    mesh, expected = SOLIDS[name]
    assert closed(mesh)
    assert volume(mesh) == pytest.approx(
        expected, rel=0.04 if name in {"sphere", "capsule", "torus"} else 1e-5
    )
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1, abs=1e-5)
    assert mesh.uvs is not None
    assert mesh.uvs.shape == (len(mesh.vertices), 2)


@pytest.mark.parametrize("name", SOLIDS)
def test_normals_agree_with_the_winding(name):
    mesh, _ = SOLIDS[name]
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    assert np.einsum("ij,ikj->ik", face, mesh.normals[mesh.triangles]).min() > 0.6


@settings(deadline=None, max_examples=20)
@given(LENGTH, LENGTH, LENGTH, st.floats(0.05, 0.9))
def test_a_chamfered_box_loses_exactly_its_edges(hx, hy, hz, share):
    bevel = share * min(hx, hy, hz)
    mesh = geometry.box(hx, hy, hz, bevel)
    straight = sum(2 * (h - bevel) * 4 * bevel**2 / 2 for h in (hx, hy, hz))
    # each corner cube keeps only the tetrahedron cut at its three inner points
    corners = 8 * (bevel**3 - bevel**3 / 6)
    assert volume(mesh) == pytest.approx(8 * hx * hy * hz - straight - corners, rel=1e-4)
    assert len(mesh.triangles) == 44
    assert np.abs(mesh.vertices).max(0) == pytest.approx([hx, hy, hz], abs=1e-6)


def test_creases_stay_sharp_and_rounds_smooth():
    cube = geometry.box(0.1, 0.1, 0.1)
    assert len(cube.vertices) == 24
    assert np.sort(np.abs(cube.normals), axis=1) == pytest.approx(
        np.tile([0, 0, 1], (24, 1)), abs=1e-6
    )
    ball = geometry.sphere(0.1, 16, 32)
    assert np.einsum("ij,ij->i", ball.normals, ball.vertices / 0.1).min() > 0.99


def test_extrusion_bevel_keeps_the_outline_and_height():
    mesh = geometry.extrude(L, 0.1, bevel=0.01)
    assert closed(mesh)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.2, 0.2, 0.1], abs=1e-6)
    assert 0.9 * 0.003 < volume(mesh) < 0.003


def test_joined_solids_add_up():
    a, b = geometry.box(0.1, 0.1, 0.1), geometry.at(geometry.box(0.1, 0.1, 0.1), (0.1, 0, 0))
    assert volume(join(a, b)) == pytest.approx(0.016, rel=1e-5)


def picture_axes(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions (M,3) in space of growing u and of falling v, and the face normals."""
    a, b, c = mesh.vertices.astype(float)[mesh.triangles].transpose(1, 0, 2)
    ua, ub, uc = mesh.uvs.astype(float)[mesh.triangles].transpose(1, 0, 2)
    jacobian = np.stack([ub - ua, uc - ua], 1)
    edges = np.stack([b - a, c - a], 1)
    along = np.linalg.solve(jacobian, edges)
    normal = np.cross(b - a, c - a)
    return along[:, 0], -along[:, 1], normal / np.linalg.norm(normal, axis=1, keepdims=True)


PRINTABLE = {
    "band": geometry.band(0.03, 0.01, 0.05),
    "decal": geometry.decal(0.1, 0.05),
    "box": geometry.box(0.1, 0.2, 0.3),
    "wall": geometry.cylinder(0.1, 0.2),
}


@pytest.mark.parametrize("name", PRINTABLE)
def test_prints_read_left_to_right_from_outside(name):
    mesh = PRINTABLE[name]
    if len(mesh.triangles) > 60:
        side = np.abs(mesh.normals[mesh.triangles][:, 0, 2]) < 0.1
        mesh = Mesh(mesh.vertices, mesh.triangles[side], mesh.normals, mesh.uvs)
    right, up, normal = picture_axes(mesh)
    handed = np.einsum("ij,ij->i", np.cross(right, up), normal)
    assert handed.min() > 0
    standing = np.abs(normal[:, 2]) < 0.5
    assert np.all(up[standing, 2] > 0)


def test_finish_drops_faces_without_area():
    mesh = finish([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0)], [(0, 1, 2), (0, 1, 3)])
    assert len(mesh.triangles) == 1


@pytest.mark.parametrize(("radius", "top"), [(0.05, 0.05), (0.04, 0.07), (0.07, 0.05)])
def test_a_ring_of_boxes_is_a_hollow_wall(radius, top):
    height, wall, n = 0.1, 0.004, 16
    pieces = colliders.ring_of_boxes(radius, wall, height, n, z=0.02, top=top)
    points = np.concatenate([c.support_points() for c in pieces])
    assert np.abs(points[:, 2].min() - 0.02) < wall
    assert np.abs(points[:, 2].max() - 0.12) < wall
    for piece in pieces:
        outer = transform(piece.pose, [(piece.size[0], 0, s * piece.size[2]) for s in (-1, 1)])
        r = np.hypot(outer[:, 0], outer[:, 1])
        assert r == pytest.approx([radius, top], rel=0.02)
        inner = transform(piece.pose, (-piece.size[0], 0, 0))
        assert np.hypot(*inner[:2]) < (radius + top) / 2 - wall * 0.9
    inside = np.array([0.0, 0, 0.07])
    local = [
        np.abs(
            transform(
                c.pose * [1, 1, 1, 1, -1, -1, -1] * [0, 0, 0, 1, 1, 1, 1], inside - c.pose[:3]
            )
        )
        for c in pieces
    ]
    assert all(np.any(p > c.size) for p, c in zip(local, pieces, strict=True))


def test_capsules_follow_their_path():
    path = [(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0.05)]
    pieces = colliders.arc_of_capsules(path, 0.01)
    for piece, a, b in zip(pieces, path[:-1], path[1:], strict=True):
        ends = transform(piece.pose, [(0, 0, -piece.size[1]), (0, 0, piece.size[1])])
        assert ends == pytest.approx(np.array([a, b]), abs=1e-9)

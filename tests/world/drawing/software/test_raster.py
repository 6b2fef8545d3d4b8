"""The rasteriser against closed forms: coverage, depth, near plane, and the sun's view."""

from uuid import uuid4

import numpy as np
import pytest
from numba.extending import is_jitted

from pipeline.poses import IDENTITY, pose, quat_from_rpy, quat_rotate
from pipeline.world.drawing import edges, masks, silhouettes, surfaces
from pipeline.world.drawing.software import (
    casters,
    changes,
    light,
    on_bodies,
    on_planes,
    raster,
    texels,
)
from pipeline.world.drawing.software.casters import fill_depths
from pipeline.world.drawing.software.changes import surrounding
from pipeline.world.drawing.software.kernels import kernel
from pipeline.world.drawing.software.raster import (
    NOTHING,
    Frame,
    Lens,
    fill_bodies,
    fill_quads,
    rotation,
    solids_of,
)
from pipeline.world.shapes import Mesh

LENS = Lens(64, 48, 50.0, 0.02, 12.0)
VIEW = np.column_stack([np.eye(3), np.zeros(3)])  # the camera is at the origin and looks along z
HERE = np.asarray(IDENTITY, float)[None]

MODULES = (
    casters,
    changes,
    light,
    on_bodies,
    on_planes,
    raster,
    texels,
    edges,
    masks,
    silhouettes,
    surfaces,
)


def drawn(corners: list, order: tuple = (0, 2, 1)) -> Frame:
    """What a triangle shows."""
    mesh = Mesh(
        np.array(corners, np.float32), np.array([order], np.uint32), np.zeros((3, 3), np.float32)
    )
    frame = blank()
    fill_bodies(solids_of([mesh]), np.array([0]), HERE, VIEW, LENS, frame)
    return frame


def blank() -> Frame:
    size = LENS.width * LENS.height
    inverse, first, second = np.zeros((3, size), np.float32)
    ids = np.full(size, NOTHING, np.int32)
    return Frame(inverse, ids, first, second, np.zeros((8, 5), np.float32))


def rays() -> np.ndarray:
    """Directions (H*W,3) of unit depth through pixel centres."""
    v, u = np.mgrid[: LENS.height, : LENS.width] + 0.5
    x, y = (u - LENS.width / 2) / LENS.focal, (v - LENS.height / 2) / LENS.focal
    return np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)


@pytest.mark.parametrize(
    "corners",
    [
        [(-0.3, -0.2, 1.0), (0.4, -0.1, 1.6), (0.0, 0.4, 0.8)],
        [(-0.02, -0.01, 1.0), (0.05, -0.03, 1.2), (0.0, 0.06, 1.1)],
        [(-0.3, 0.2, 1.5), (0.5, 0.25, 1.0), (0.1, 0.2, -0.6)],  # a corner behind the camera
    ],
)
def test_a_triangle_covers_the_rays_that_meet_it(corners: list) -> None:
    a, b, c = np.array(corners, float)
    if (np.cross(b - a, c - a) @ a) > 0:
        b, c = c, b
    frame = drawn([tuple(a), tuple(b), tuple(c)], (0, 1, 2))
    weights = np.linalg.solve(np.stack([a, b, c], 1), rays().T).T
    q = weights.sum(1)
    inside = (weights >= 0).all(1) & (q > 0) & (q <= 1 / LENS.near)
    sure = np.abs(weights).min(1) > 1e-6
    assert inside.sum() > 5
    assert np.array_equal((frame.ids == 0)[sure], inside[sure])
    seen = (frame.ids == 0) & sure
    assert np.allclose(frame.inverse[seen], q[seen], rtol=1e-5)
    assert np.allclose(frame.first[seen], weights[seen, 1], atol=1e-4 * q.max())
    assert np.allclose(frame.second[seen], weights[seen, 2], atol=1e-4 * q.max())


def test_what_is_turned_away_is_not_drawn_and_the_nearer_wins() -> None:
    corners = [(-0.3, -0.2, 1.0), (0.4, -0.1, 1.0), (0.0, 0.4, 1.0)]
    one, other = drawn(corners, (0, 1, 2)), drawn(corners, (0, 2, 1))
    assert ((one.ids == 0).any()) != ((other.ids == 0).any())
    order = (0, 1, 2) if (one.ids == 0).any() else (0, 2, 1)
    both = Mesh(
        np.array([*corners, *(np.array(corners) * 1.5)], np.float32),
        np.array([np.add(order, 3), order], np.uint32),
        np.zeros((6, 3), np.float32),
    )
    frame = blank()
    fill_bodies(solids_of([both]), np.array([0]), HERE, VIEW, LENS, frame)
    assert set(np.unique(frame.ids)) == {NOTHING, 1}  # the far one has the same outline


def test_the_walls_of_a_room_leave_no_seam() -> None:
    low, high = np.array([-1.0, -1.2, -0.7]), np.array([1.4, 0.9, 2.0])
    turn = rotation(pose((0, 0, 0), quat_from_rpy(0.3, 0.5, -0.2)))
    quads = []
    for axis in range(3):
        for end in (low, high):
            a, b, c = (end.copy() for _ in range(3))
            other = (low + high) - end
            b[(axis + 1) % 3], c[(axis + 2) % 3] = (other[(axis + 1) % 3], other[(axis + 2) % 3])
            quads.append([a, b, c] if np.dot(a, np.cross(b, c)) < 0 else [a, c, b])
    frame = blank()
    fill_quads(np.array(quads) @ turn.T, np.ones(6, np.bool_), LENS, frame)
    directions = rays() @ turn
    with np.errstate(divide="ignore"):
        near = np.where(directions > 0, high / directions, low / directions).min(1)
    assert (frame.ids != NOTHING).all() and np.allclose(frame.inverse, 1 / near, rtol=1e-4)


def test_a_rotation_is_that_of_the_quaternion() -> None:
    at = pose((1, 2, 3), quat_from_rpy(0.4, -1.1, 2.0))
    assert np.allclose(rotation(at), quat_rotate(at[3:], np.eye(3)).T)


def test_the_sun_sees_far_sides_and_blocks_hold_their_least_and_most() -> None:
    corners = np.array([(4, 4, 0.2), (28, 4, 0.3), (4, 28, 0.4)], np.float32)
    depths, shown = np.ones((32, 32), np.float32), np.array([0])
    for order in ((0, 1, 2), (0, 2, 1)):
        mesh = Mesh(corners, np.array([order], np.uint32), np.zeros((3, 3), np.float32))
        fill_depths(solids_of([mesh]), shown, HERE, VIEW, depths)
    y, x = np.mgrid[:32, :32] + 0.5
    inside = (x > 4) & (y > 4) & (x + y < 31.9)
    expected = 0.2 + (x - 4) / 24 * 0.1 + (y - 4) / 24 * 0.2
    assert np.allclose(depths[inside], expected[inside], atol=1e-5)
    assert (depths[x + y > 32.1] == 1).all()
    least, most = np.empty((2, 8, 8), np.float32)
    surrounding(depths, least, most)
    assert least[2, 2] == depths[4:16, 4:16].min() and most[2, 2] == depths[4:16, 4:16].max()
    assert least[0, 7] == depths[:8, 24:].min() and most[0, 7] == depths[:8, 24:].max()


def test_no_kernel_may_reorder_sums_or_fuse_products() -> None:
    """With such freedom a cached kernel and one that was compiled in another order differed in
    their last bits, and so did the bytes of an episode."""
    kernels = [each for module in MODULES for each in vars(module).values() if is_jitted(each)]
    assert len(kernels) > 20
    for each in kernels:
        assert set(each.targetoptions.get("fastmath") or ()) <= {"nnan", "nsz"}, each.__name__


def double(x: float) -> float:
    return 2 * x


def test_a_kernel_is_compiled_again_if_any_source_of_the_rasteriser_changed() -> None:
    """Numba itself looks only at the file in which the kernel stands."""
    old, new = uuid4().hex, uuid4().hex
    found = list[bool]()
    for sources in (old, old, new):
        compiled = kernel(double, sources)
        assert compiled(2.0) == 4.0
        found.append(bool(compiled.stats.cache_hits))
    assert found == [False, True, False]

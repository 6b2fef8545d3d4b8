"""What a camera may see, against the projection of many points."""

import numpy as np

from pipeline.data.cameras import CameraType, look, visible
from pipeline.poses import compose, pose, transform
from pipeline.world.drawing.engine import FAR, NEAR
from pipeline.world.drawing.masks import BLOCK
from pipeline.world.drawing.seen import in_view, looked_up
from pipeline.world.drawing.shadows import SHADOW_HALF_SIZE, SHADOW_MAP, sun_axes

KIND = CameraType(64, 48, 40.0)


def random_poses(rng: np.random.Generator, count: int, reach: float) -> np.ndarray:
    q = rng.normal(size=(count, 4))
    return np.concatenate(
        [rng.uniform(-reach, reach, (count, 3)), q / np.linalg.norm(q, axis=1)[:, None]], 1
    )


def test_no_body_with_a_point_in_the_image_is_left_out_and_most_others_are() -> None:
    rng = np.random.default_rng(3)
    cameras, bodies = random_poses(rng, 60, 0.5), random_poses(rng, 60 * 5, 1.5).reshape(60, 5, 7)
    centres, halves = rng.uniform(-0.2, 0.2, (5, 3)), rng.uniform(0.01, 0.3, (5, 3))
    found = in_view(KIND, cameras, bodies, centres, halves)
    points = centres[:, None] + rng.uniform(-1, 1, (5, 3000, 3)) * halves[:, None]
    seen = np.array(
        [
            [visible(KIND, cameras[t], transform(bodies[t, n], points[n])).any() for n in range(5)]
            for t in range(60)
        ]
    )
    assert found.shape == (60, 5) and found[seen].all()
    assert seen.sum() > 30 and np.mean(found[~seen]) < 0.35


def test_edges_of_the_view_are_where_the_projection_puts_them() -> None:
    camera = np.array([0.1, 0.2, 1.0, 1, 0, 0, 0])
    side = np.tan(np.radians(20)) * 64 / 48  # of the image at 1 m, to the left
    dot = np.array([[0.0, 0, 0]]), np.array([[0.01, 0.01, 0.01]])
    for y, inside in ((side - 0.02, True), (side + 0.02 + 0.01 * side, False)):
        body = compose(camera, pose((1.0, y, 0.0)))
        assert in_view(KIND, camera[None], body[None, None], *dot)[0, 0] == inside
    behind = compose(camera, pose((-0.1, 0, 0)))
    assert not in_view(KIND, camera[None], behind[None, None], *dot)[0, 0]


def test_shadows_are_looked_up_where_the_image_shows_the_table() -> None:
    camera, sun, depth = look((0.1, 0.05, 1.24), (0.0, 0.001, -1.0)), (0.0, 0.0, -1.0), 0.5
    buffer = np.full((48, 64), (FAR - NEAR * FAR / depth) / (FAR - NEAR), np.float32)
    table, floor, depths = looked_up(KIND, camera, buffer, sun)
    assert not floor.any() and np.array_equal(table, depths)
    axes, rows = sun_axes(sun), np.argwhere(table).mean(0)
    x, y = ((rows[::-1] + 0.5) * BLOCK / SHADOW_MAP * 2 - 1) * SHADOW_HALF_SIZE * (-1, 1)
    middle = x * axes[0] + y * axes[1]
    assert np.allclose(middle[:2], (0.1, 0.05), atol=0.02)
    area = 4 * depth**2 * np.tan(np.radians(20)) ** 2 * 64 / 48
    assert area < table.sum() * (BLOCK * 2 * SHADOW_HALF_SIZE / SHADOW_MAP) ** 2 < 2 * area

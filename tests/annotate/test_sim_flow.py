"""Exact flow against closed forms and against projecting each point by itself."""

import numpy as np
import pytest

from pipeline.annotate.flow_stage import body_motions, exact_flow, exact_flows, shrink_flow
from pipeline.annotate.stage import SimView
from pipeline.data.cameras import CameraType, extrinsics_cv, intrinsics
from pipeline.poses import IDENTITY, compose, frame, inverse, pose, quat_about, transform

KIND = CameraType(80, 60, 40.0)
K = intrinsics(KIND)
F = K[0, 0]
DOWN = frame((0, 0, 2.0), (0, 0, -1), (-1, 0, 0))  # looks straight down; image right = world x


def test_sliding_body_moves_by_f_over_z():
    depth = np.full((60, 80), 1250, np.uint16)
    seg = np.zeros((60, 80), np.uint8)
    seg[20:30, 10:40] = 1
    bodies = np.stack([pose((0.1, 0.2, 0.7))[None], pose((0.13, 0.18, 0.7))[None]])
    flow = exact_flow(depth * 1e-3, seg, K, body_motions(bodies[0], bodies[1], DOWN, DOWN))
    expected = np.array([F * 0.03 / 1.25, -F * -0.02 / 1.25])  # world y is image up
    np.testing.assert_allclose(flow[seg == 1], np.tile(expected, (300, 1)), atol=1e-5)
    assert (flow[seg == 0] == 0).all()


def test_camera_motion_over_a_still_world_with_and_without_depth():
    depth = np.full((60, 80), 1000, np.uint16)
    depth[:30] = 0
    seg = np.ones((60, 80), np.uint8)
    still = IDENTITY[None]
    moved = DOWN + np.array([0.02, 0, 0, 0, 0, 0, 0])
    flow = exact_flow(depth * 1e-3, seg, K, body_motions(still, still, DOWN, moved))
    np.testing.assert_allclose(flow[30:], np.broadcast_to([-F * 0.02, 0.0], (30, 80, 2)), atol=1e-5)
    assert np.abs(flow[:30]).max() < 1e-9  # at infinity a translation is not seen
    # roll about the viewing axis
    turned = compose(DOWN, pose((0, 0, 0), quat_about((1, 0, 0), 0.1)))
    flow = exact_flow(depth * 1e-3, seg, K, body_motions(still, still, DOWN, turned))
    u, v = np.meshgrid(np.arange(80) + 0.5 - 40, np.arange(60) + 0.5 - 30)
    angle = -0.1
    expected = np.stack(
        [np.cos(angle) * u - np.sin(angle) * v - u, np.sin(angle) * u + np.cos(angle) * v - v], -1
    )
    np.testing.assert_allclose(flow, expected, atol=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_against_each_point_projected_by_itself(seed: int):
    rng = np.random.default_rng(seed)
    seg = rng.integers(0, 4, (60, 80)).astype(np.uint8)
    depth = rng.integers(600, 1500, (60, 80)).astype(np.uint16)

    def wobble(p: np.ndarray, size: float) -> np.ndarray:
        return compose(
            p, pose(rng.normal(0, size, 3), quat_about(rng.normal(size=3), rng.normal(0, size * 3)))
        )

    bodies_a = np.stack([wobble(pose(rng.normal(0, 0.3, 3)), 0.1) for _ in range(3)])
    bodies_b = np.stack([wobble(p, 0.02) for p in bodies_a])
    camera_a = wobble(DOWN, 0.1)
    camera_b = wobble(camera_a, 0.01)
    flow = exact_flow(depth * 1e-3, seg, K, body_motions(bodies_a, bodies_b, camera_a, camera_b))
    e_a, e_b = extrinsics_cv(camera_a), extrinsics_cv(camera_b)
    for _ in range(60):
        row, column = rng.integers(60), rng.integers(80)
        z = depth[row, column] / 1000
        seen = np.array([(column + 0.5 - K[0, 2]) / F * z, (row + 0.5 - K[1, 2]) / F * z, z])
        world = e_a[:, :3].T @ (seen - e_a[:, 3])
        if seg[row, column]:
            body = seg[row, column] - 1
            world = transform(bodies_b[body], transform(inverse(bodies_a[body]), world))
        later = K @ (e_b[:, :3] @ world + e_b[:, 3])
        expected = later[:2] / later[2] - [column + 0.5, row + 0.5]
        np.testing.assert_allclose(flow[row, column], expected, atol=2e-5)


def test_shrinking_averages_and_rescales():
    flow = np.random.default_rng(0).normal(size=(60, 80, 2)).astype(np.float32)
    small = shrink_flow(flow, (20, 15))
    expected = flow.reshape(15, 4, 20, 4, 2).mean((1, 3)) / 4
    np.testing.assert_allclose(small, expected, atol=1e-5)
    assert shrink_flow(flow, (80, 60)) is flow


def test_rows_are_absolute_pairs():
    frames = 6
    depth = np.full((frames, 60, 80), 1000, np.uint16)
    seg = np.ones((frames, 60, 80), np.uint8)
    bodies = np.repeat(IDENTITY[None, None], frames, 0)
    bodies[:, 0, 0] = 0.01 * np.arange(frames) ** 2
    view = SimView(seg, depth, np.repeat(DOWN[None], frames, 0), K)
    flow = exact_flows(view, bodies, 4, (80, 60))
    moves = [0.0, 0.01, 0.04, 0.09, 0.16, 0.25 - 0.01]
    np.testing.assert_allclose(flow[..., 0].mean((1, 2)), F * np.array(moves), atol=1e-4)

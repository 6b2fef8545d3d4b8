"""Grasp candidates against plain trigonometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.poses import frame, quat_rotate
from pipeline.world.objects.grasping import (
    PALM,
    bar_pinches,
    box_pinches,
    handle_pinches,
    low_heights,
    pinches,
    rim_pinches,
    side_pinches,
    turned,
)


def parts(grasps) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, approaches and openings, each (N,3)."""
    poses = np.array([g.pose for g in grasps])
    return poses[:, :3], *(quat_rotate(poses[:, 3:], axis) for axis in np.eye(3)[:2])


def pitch(approach: np.ndarray) -> np.ndarray:
    return np.degrees(np.arcsin(np.clip(-approach[:, 2], -1, 1)))


@settings(deadline=None, max_examples=30)
@given(st.lists(st.floats(-1, 1), min_size=9, max_size=9))
def test_batched_poses_equal_single_ones(numbers):
    position, x, y = np.reshape(numbers, (3, 3))
    if np.linalg.norm(np.cross(x, y)) < 1e-2:
        return
    (grasp,) = pinches([(position, x, y)], 0.05)
    single = frame(position, x, y)
    assert grasp.pose[:3] == pytest.approx(single[:3])
    assert abs(grasp.pose[3:] @ single[3:]) == pytest.approx(1)
    assert grasp.width == 0.05


def test_side_pinches_surround_the_body():
    position, approach, opening = parts(grasps := side_pinches(0.03, 0.08))
    assert len(grasps) == 16 * 7
    assert sorted(set(np.round(pitch(approach)))) == [0, 15, 30, 45, 60, 75, 90]
    assert position == pytest.approx(np.tile([0, 0, 0.08], (len(grasps), 1)))
    assert opening[:, 2] == pytest.approx(0, abs=1e-9)
    assert all(g.width == 0.06 for g in grasps)
    level = np.abs(approach[:, 2]) < 1e-9
    azimuth = np.sort(np.arctan2(approach[level, 1], approach[level, 0]))
    assert np.diff(azimuth) == pytest.approx(np.pi / 8, abs=1e-6)


@given(st.floats(0.015, 0.034), st.floats(0.02, 0.2))
@settings(deadline=None, max_examples=30)
def test_palms_stay_out_of_the_body(radius, height):
    top = 0.2
    grasps = side_pinches(radius, height, outline=[(radius, 0.0), (radius, top)])
    if not grasps:
        return
    position, approach, _ = parts(grasps)
    palm = position - PALM * approach
    assert not np.any(
        (np.hypot(palm[:, 0], palm[:, 1]) < radius) & (palm[:, 2] < top) & (palm[:, 2] > 0)
    )
    # the fingers still close round the widest part: the tcp is short of the axis by at most 8 mm
    assert np.linalg.norm(position - [0, 0, height], axis=1).max() < 0.0081
    assert np.all(pitch(approach)[palm[:, 2] < top] < 75)


def test_a_low_thick_body_is_only_taken_from_where_the_palm_has_room():
    steep = side_pinches(0.032, 0.03, outline=[(0.032, 0.0), (0.032, 0.2)])
    assert pitch(parts(steep)[1]).max() < 31
    near_top = side_pinches(0.032, 0.18, outline=[(0.032, 0.0), (0.032, 0.2)])
    assert pitch(parts(near_top)[1]).max() > 89


def test_rim_pinches_lie_in_the_wall():
    position, approach, opening = parts(grasps := rim_pinches(0.05, 0.004, 0.1, depth=0.012))
    assert np.hypot(position[:, 0], position[:, 1]) == pytest.approx(0.048)
    assert position[:, 2] == pytest.approx(0.088)
    out = position * [1, 1, 0] / 0.048
    assert np.abs(np.einsum("ij,ij->i", out, opening)) == pytest.approx(1)
    assert pitch(approach).min() == pytest.approx(45)
    assert {g.width for g in grasps} == {0.004}


def test_flared_rims_are_taken_across_the_wall():
    flare = 30.0
    _, approach, opening = parts(rim_pinches(0.06, 0.004, 0.05, pitches=(90,), flare=flare))
    assert -approach[:, 2] == pytest.approx(np.cos(np.radians(flare)))
    assert np.abs(opening[:, 2]) == pytest.approx(np.sin(np.radians(flare)))


def test_boxes_are_pinched_across_what_fits():
    grasps = box_pinches(0.05, 0.03, 0.06)
    _, approach, opening = parts(grasps)
    assert np.abs(opening[:, 1]) == pytest.approx(1)
    assert {g.width for g in grasps} == {0.06}
    assert np.any(approach[:, 0] > 0.4)
    assert np.any(approach[:, 0] < -0.4)
    both = box_pinches(0.03, 0.02, 0.05)
    assert {round(g.width, 6) for g in both} == {0.06, 0.04}
    assert box_pinches(0.05, 0.05, 0.05) == ()


def test_low_things_get_several_heights_and_reachable_ones_only():
    assert low_heights(0.1) == pytest.approx((0.075,))
    assert low_heights(0.04) == (0.022,)
    assert low_heights(0.015) == (0.012, 0.017, 0.022)
    position, approach, _ = parts(box_pinches(0.03, 0.07, 0.0075, axes="x"))
    fingertip = position[:, 2] + 0.010 * approach[:, 2]
    assert fingertip.max() <= 0.015 - 0.002 + 1e-9


def test_bars_and_handles_are_taken_across():
    position, approach, opening = parts(bar_pinches([-0.1, 0.1], 0.012, 0.05))
    assert set(np.round(position[:, 0], 6)) == {-0.1, 0.1}
    assert np.abs(opening[:, 1]) == pytest.approx(1)
    assert pitch(approach).min() == pytest.approx(30)
    _, approach, opening = parts(handle_pinches((0, 0, 0.1), (0, 0, 1), (1, 0, 0), 0.01))
    assert np.abs(opening[:, 1]) == pytest.approx(1)
    assert np.all(approach[:, 0] < 0)


def test_turning_grasps_turns_everything():
    grasps = bar_pinches([0.1], 0.012, 0.05)
    position, approach, opening = parts(turned(grasps, np.pi / 2))
    before = parts(grasps)
    for now, was in zip((position, approach, opening), before, strict=True):
        assert now == pytest.approx(was[:, [1, 0, 2]] * [-1, 1, 1])

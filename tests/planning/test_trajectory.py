"""Time parameterisation: limits, end states, spacing, closed forms, and toppra as the independent
reference."""

from itertools import pairwise

import numpy as np
import pytest
import toppra
import toppra.algorithm
import toppra.constraint
from hypothesis import given, settings
from hypothesis import strategies as st
from toppra.interpolator import AbstractGeometricPath

from pipeline.data.clock import PHYSICS_HZ
from pipeline.planning.failure import PlanFailure
from pipeline.planning.path import dense
from pipeline.planning.trajectory import RoundedPolyline, Trajectory, time_parameterise

V = np.array([1.4, 1.4, 1.0, 2.0, 2.0, 3.0])
A = np.array([6.0, 5.0, 6.0, 8.0, 8.0, 10.0])


def duration(t: Trajectory) -> float:
    return (len(t.q) - 1) / PHYSICS_HZ


def check(
    t: Trajectory, first: np.ndarray, last: np.ndarray, v: np.ndarray = V, a: np.ndarray = A
) -> None:
    """Ends, limits by finite differences of q alone, and qd as the derivative of q."""
    np.testing.assert_array_equal(t.q[0], first)
    np.testing.assert_array_equal(t.q[-1], last)
    assert (t.qd[0] == 0).all() and (t.qd[-1] == 0).all()
    speed = np.diff(t.q, axis=0) * PHYSICS_HZ
    assert (np.abs(speed) <= v * 1.0001).all()
    assert (np.abs(np.diff(speed, axis=0)) * PHYSICS_HZ <= a * 1.001).all()
    assert (np.abs(t.qd) <= v * 1.0001).all()
    # the mean of both ends' velocities is the mean velocity of a step, up to the jumps of
    # acceleration in it
    assert np.abs(0.5 * (t.qd[1:] + t.qd[:-1]) - speed).max() <= a.max() / PHYSICS_HZ


def random_path(seed: int, corners: int, scale: float = 1.5) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-scale, scale, (corners, 6))


class ToppraPath(AbstractGeometricPath):
    """A rounded polyline as toppra wants it."""

    def __init__(self, path: RoundedPolyline) -> None:
        self.path = path

    def __call__(self, path_positions, order=0):
        return self.path(path_positions, order)

    @property
    def dof(self) -> int:
        return self.path.base.shape[1]

    @property
    def path_interval(self) -> np.ndarray:
        return self.path.knots[[0, -1]]


def toppra_duration(path: AbstractGeometricPath, grid: np.ndarray) -> float:
    limits = [
        toppra.constraint.JointVelocityConstraint(np.stack([-V, V], axis=1)),
        toppra.constraint.JointAccelerationConstraint(np.stack([-A, A], axis=1)),
    ]
    speeds = toppra.algorithm.TOPPRA(limits, path, gridpoints=grid).compute_parameterization(
        0.0, 0.0
    )[1]
    assert speeds is not None
    return float(np.sum(2 * np.diff(grid) / (speeds[1:] + speeds[:-1])))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), corners=st.integers(2, 7), scale=st.floats(0.01, 3.0))
def test_limits_and_ends_hold_on_random_polylines(seed: int, corners: int, scale: float) -> None:
    path = random_path(seed, corners, scale)
    check(time_parameterise(path, V, A), path[0], path[-1])


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 100_000), corners=st.integers(3, 6))
def test_never_slower_than_a_stop_at_every_corner(seed: int, corners: int) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-1, 1, (corners - 1, 6)) * 10 ** rng.uniform(-3, 0.5, (corners - 1, 1))
    path = np.vstack([np.zeros(6), np.cumsum(steps, axis=0)])
    stops = sum(duration(time_parameterise(pair, V, A)) for pair in pairwise(path))
    assert duration(time_parameterise(path, V, A)) <= 1.05 * stops + 0.01


def test_a_sharp_bend_before_a_short_last_segment_is_not_slow() -> None:
    path = np.array(
        [
            [-0.69, 1.43, 1.0, -1.19, -0.52, 1.46],
            [-0.48, 2.42, 2.48, -1.52, 0.54, -1.72],
            [-0.44, 2.44, 2.49, -1.53, 0.52, -1.75],
        ]
    )
    assert duration(time_parameterise(path, V, A)) < 4.0  # 3.18 rad at 1.4 rad/s and a little


def test_dense_cartesian_like_path() -> None:
    s = np.linspace(0, 1, 25)[:, None]
    path = np.hstack([0.3 * s, 0.2 * s**2, np.sin(2 * s), 0.1 * np.cos(3 * s), -0.4 * s, 0 * s])
    t = time_parameterise(path, V, A)
    check(t, path[0], path[-1])
    assert max(np.abs(dense(path, 0.002) - q).max(axis=1).min() for q in t.q[::7]) < 0.002


@pytest.mark.parametrize("seed", range(4))
def test_polyline_is_as_fast_as_toppra_allows(seed: int) -> None:
    corners = random_path(seed, 5)
    path = RoundedPolyline(corners, 0.01)
    knots = path.knots
    # toppra reads q'' at grid points only, so put points on both sides of every jump
    grid = np.concatenate(
        [np.linspace(a + 1e-5, b - 1e-5, 2 + int((b - a) / 0.03)) for a, b in pairwise(knots)]
    )
    want = toppra_duration(ToppraPath(path), np.concatenate([[0.0], grid, knots[-1:]]))
    assert duration(time_parameterise(corners, V, A)) == pytest.approx(
        want, rel=0.01, abs=1.5 / 240
    )


@pytest.mark.parametrize("span", [0.02, 0.4, 2.5])
def test_straight_move_is_the_trapezoid_and_agrees_with_toppra(span: float) -> None:
    a, b = np.zeros(6), span * np.array([1.0, -0.5, 0.7, 0.1, 0.0, 0.9])
    t = time_parameterise(np.stack([a, b]), V, A)
    check(t, a, b)
    with np.errstate(divide="ignore"):
        w, c = (V / np.abs(b)).min(), (A / np.abs(b)).min()
    closed = 1 / w + w / c if w * w < c else 2 / np.sqrt(c)
    assert closed <= duration(t) <= closed + 1 / 240 + 1e-9
    line = toppra.SplineInterpolator([0.0, 0.5, 1.0], np.stack([a, 0.5 * (a + b), b]))
    assert duration(t) == pytest.approx(
        toppra_duration(line, np.linspace(0, 1, 200)), rel=0.01, abs=1.5 / 240
    )
    assert (
        np.abs(t.q - a - np.outer((t.q - a) @ (b - a) / ((b - a) @ (b - a)), b - a)).max() < 1e-12
    )


@pytest.mark.parametrize("deviation", [0.001, 0.01, 0.05])
def test_rounding_stays_near_the_polyline_and_is_smooth(deviation: float) -> None:
    corners = random_path(3, 6)
    path = RoundedPolyline(corners, deviation)
    s = np.linspace(0, path.knots[-1], 4000)
    q = path(s)
    fine = dense(corners, 0.002)
    away = max(np.abs(fine - row).max(axis=1).min() for row in q[::10])
    assert 0.3 * deviation < away < deviation + 0.002
    np.testing.assert_allclose(
        np.gradient(q, s, axis=0)[1:-1], path(s, 1)[1:-1], atol=2 * np.diff(s)[0] / deviation
    )
    jumps = np.abs(path(path.knots[1:-1] - 1e-9, 1) - path(path.knots[1:-1] + 1e-9, 1))
    assert jumps.max() < 1e-6
    np.testing.assert_allclose(path(path.knots[[0, -1]]), corners[[0, -1]], atol=1e-12)


def test_reversals_and_repeated_waypoints() -> None:
    there = np.array([0.0, 0, 0, 0, 0, 0]), np.array([0.5, 0.2, 0, 0, 0, 0])
    back = np.stack([there[0], there[1], there[0]])
    check(time_parameterise(back, V, A), there[0], there[0])
    path = random_path(1, 4)
    repeated = np.repeat(path, [3, 1, 2, 4], axis=0)
    once, many = time_parameterise(path, V, A), time_parameterise(repeated, V, A)
    np.testing.assert_allclose(once.q, many.q, atol=1e-9)


def test_no_motion() -> None:
    q = np.arange(6.0)
    for waypoints in (q, q[None], np.stack([q, q]), np.stack([q, q + 1e-9, q])):
        t = time_parameterise(waypoints, V, A)
        assert t.q.shape == (1, 6) and duration(t) == 0
        np.testing.assert_array_equal(t.q[0], q)
    waiting = time_parameterise(q[None], V, A, minimum_duration=0.5)
    assert waiting.q.shape == (121, 6) and (waiting.qd == 0).all()


@pytest.mark.parametrize("corners", [2, 4])
def test_minimum_duration_stretches_and_never_shortens(corners: int) -> None:
    path = random_path(2, corners)
    short = time_parameterise(path, V, A)
    slow = time_parameterise(path, V, A, minimum_duration=12.0)
    assert duration(slow) == pytest.approx(12.0, abs=1e-9)
    check(slow, path[0], path[-1])
    middle = len(slow.q) // 2
    at = middle / 240 / 12.0 * duration(short)
    near = int(at * 240)
    assert np.abs(slow.q[middle] - short.q[near]).max() < 2 * V.max() / 240
    assert duration(time_parameterise(path, V, A, minimum_duration=0.1)) == duration(short)


def test_deterministic_and_bad_input() -> None:
    path = random_path(8, 5)
    first, second = time_parameterise(path, V, A), time_parameterise(path, V, A)
    np.testing.assert_array_equal(first.q, second.q)
    np.testing.assert_array_equal(first.qd, second.qd)
    path[2, 1] = np.nan
    with pytest.raises(PlanFailure, match="time_parameterisation: waypoints must be finite"):
        time_parameterise(path, V, A)
    with pytest.raises(PlanFailure):
        time_parameterise(random_path(8, 5), 0 * V, A)

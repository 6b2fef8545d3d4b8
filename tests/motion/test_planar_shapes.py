import numpy as np
import pytest
from scipy.stats import foldnorm, kstest

from pipeline.motion.contract import MotionRequest
from pipeline.motion.planar import evaluate
from pipeline.motion.planar_shapes import (
    DRAW,
    SHORTEST_PIECE,
    draw_level_1,
    draw_level_2,
    draw_level_3,
)
from pipeline.motion.workspace import Workspace

TABLE = Workspace(-0.35, 0.35, -0.25, 0.15)
END = np.array([0.12, -0.08])


def asked(alpha, total, workspace=TABLE):
    return MotionRequest(1, alpha, total, np.append(END, 0.75), workspace)


def along(paths, s):
    return evaluate(paths.coefficients, s)


def test_level_1_speeds_follow_the_clipped_folded_normal():
    n, alpha, total = 20000, 0.1, 3.0
    paths = draw_level_1(np.random.default_rng(5), n, asked(alpha, total))
    speed = np.linalg.norm(paths.coefficients[:, 0, :, 1], axis=-1) / total
    law = foldnorm(c=0.8 * 3, scale=alpha / 3)
    assert speed.min() >= 0.01 - 1e-12
    assert speed.max() <= alpha + 1e-12
    four_sigma = 4 * np.sqrt(0.25 / n)
    assert abs((speed > alpha - 1e-9).mean() - law.sf(alpha)) < four_sigma
    assert abs((speed < 0.01 + 1e-9).mean() - law.cdf(0.01)) < four_sigma
    between = speed[(speed > 0.01 + 1e-9) & (speed < alpha - 1e-9)]
    low, high = law.cdf([0.01, alpha])
    assert kstest(between, lambda v: (law.cdf(v) - low) / (high - low)).pvalue > 1e-3


def test_level_1_directions_are_uniform_and_the_start_is_the_end_minus_v_t():
    paths = draw_level_1(np.random.default_rng(6), 5000, asked(0.2, 2.5))
    way = paths.coefficients[:, 0, :, 1]
    np.testing.assert_allclose(along(paths, 0.0)[:, 0], END - (way / 2.5) * 2.5, atol=1e-15)
    np.testing.assert_allclose(along(paths, 1.0)[:, 0], np.broadcast_to(END, (5000, 2)), atol=1e-15)
    angle = np.arctan2(way[:, 1], way[:, 0]) % (2 * np.pi)
    assert kstest(angle / (2 * np.pi), "uniform").pvalue > 1e-3


def test_level_1_below_a_centimetre_per_second_keeps_to_alpha():
    paths = draw_level_1(np.random.default_rng(7), 100, asked(0.004, 2.0))
    np.testing.assert_allclose(np.linalg.norm(paths.coefficients[:, 0, :, 1], axis=-1), 0.004 * 2.0)


def test_level_2_passes_control_points_beside_the_chord():
    n = 600
    paths = draw_level_2(np.random.default_rng(8), n, asked(0.1, 6.0))
    c = paths.coefficients[:, 0]
    np.testing.assert_allclose(evaluate(c, 1.0), np.broadcast_to(END, (n, 2)), atol=1e-12)
    degree = 4 - (c[..., ::-1] != 0).any(1).argmax(-1)
    counts = np.bincount(degree, minlength=5)
    assert counts[:2].sum() == 0
    assert (np.abs(counts[2:] - n / 3) < 4 * np.sqrt(n * 2 / 9)).all()
    for k in (3, 4, 5):
        rows = c[degree == k - 1]
        start = evaluate(rows, 0.0)
        assert TABLE.contains(start).all()
        for s in np.arange(1, k - 1) / (k - 1):
            point, chord = evaluate(rows, s), start + s * (END - start)
            assert (np.abs(point - chord) <= 0.1 + 1e-12).all()
            assert TABLE.contains(point).all()


@pytest.mark.parametrize(("level", "noise"), [(2, 0.1), (3, 0.08)])
def test_inner_control_points_are_beside_the_chord_by_any_share_of_the_noise(level, noise):
    """Of curves through three points, in a workspace whose edges no control point meets."""
    paths = DRAW[level](np.random.default_rng(13), 4000, asked(0.1, 6.0, Workspace(-3, 3, -3, 3)))
    c = paths.coefficients[:, 0]
    middle = c[(c[..., 2] != 0).all(-1) & (c[..., 3:] == 0).all((-1, -2))]
    beside = evaluate(middle, 0.5) - (evaluate(middle, 0.0) + evaluate(middle, 1.0)) / 2
    assert len(middle) > 700
    for axis in beside.T:
        assert kstest(axis / noise, "uniform", args=(-1, 2)).pvalue > 1e-3


def test_level_3_pieces_join_and_add_up():
    n, alpha, total = 2000, 0.1, 4.0
    paths = draw_level_3(np.random.default_rng(9), n, asked(alpha, total))
    used = paths.durations > 0
    count = used.sum(-1)
    assert set(count) == {2, 3}
    assert abs((count == 2).mean() - 0.5) < 4 * np.sqrt(0.25 / n)
    np.testing.assert_allclose(paths.durations.sum(-1), total, rtol=1e-12)
    assert paths.durations[used].min() >= SHORTEST_PIECE
    begin, finish = along(paths, 0.0), along(paths, 1.0)
    for i in (1, 2):
        np.testing.assert_allclose(begin[used[:, i], i], finish[used[:, i], i - 1], atol=1e-12)
    last = finish[np.arange(n), count - 1]
    np.testing.assert_array_equal(np.linalg.norm(last - END, axis=-1) > 1e-9, paths.missed)
    assert 0 < paths.missed.mean() < 0.2
    straight = (paths.coefficients[..., 2:] == 0).all((-1, -2)) & used
    assert abs(straight.sum() / used.sum() - 0.2) < 4 * np.sqrt(0.16 / used.sum())
    speed = (
        np.linalg.norm(paths.coefficients[..., 1], axis=-1)[straight] / paths.durations[straight]
    )
    assert speed.max() <= alpha * (1 + 1e-12)


def test_level_3_straight_pieces_aim_at_the_whole_workspace():
    alpha, total, n = 0.05, 1.5, 4000
    paths = draw_level_3(np.random.default_rng(12), n, asked(alpha, total))
    c, duration = paths.coefficients[:, 0], paths.durations[:, 0]
    straight = (c[..., 2:] == 0).all((-1, -2))
    clamped = np.linalg.norm(c[straight, :, 1], axis=-1) > alpha * duration[straight] - 1e-9
    # a target is clamped unless it lies within alpha * duration of the start: at most that circle's
    # share of the rectangle
    unclamped = (np.pi * (alpha * duration[straight]) ** 2 / (0.7 * 0.4)).mean()
    assert straight.sum() > 600
    assert (~clamped).mean() < unclamped + 4 * np.sqrt(unclamped / straight.sum())


def test_level_3_durations_are_dirichlet_above_the_shortest_piece():
    paths = draw_level_3(np.random.default_rng(10), 4000, asked(0.1, 4.0))
    for count in (2, 3):
        rows = paths.durations[(paths.durations > 0).sum(-1) == count, :count]
        share = (rows - SHORTEST_PIECE) / (4.0 - count * SHORTEST_PIECE)
        # a marginal of Dirichlet(1, ..., 1) with k parts is Beta(1, k - 1)
        for i in range(count):
            assert kstest(share[:, i], lambda x, k=count: 1 - (1 - x) ** (k - 1)).pvalue > 1e-3


def test_very_short_motions_still_have_pieces():
    paths = draw_level_3(np.random.default_rng(11), 200, asked(0.1, 0.12))
    assert paths.durations[paths.durations > 0].min() >= 0.02
    np.testing.assert_allclose(paths.durations.sum(-1), 0.12)


@pytest.mark.parametrize("level", DRAW)
def test_the_same_stream_draws_the_same_paths(level):
    a, b, c = (DRAW[level](np.random.default_rng(seed), 50, asked(0.1, 3.0)) for seed in (1, 1, 2))
    assert a.coefficients.tobytes() == b.coefficients.tobytes()
    assert a.coefficients.tobytes() != c.coefficients.tobytes()

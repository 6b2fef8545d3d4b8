"""Statistics against numpy on the raw values."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.export.shared.statistics import (
    PERCENTILES,
    color_counts,
    image_stats,
    sample_rows,
    vector_stats,
)


@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 60), st.integers(1, 3)),
        elements=st.floats(-100, 100, width=32),
    )
)
def test_vector_stats_are_numpys(values):
    stats = vector_stats(values)
    np.testing.assert_array_equal(stats["min"], values.min(0))
    np.testing.assert_array_equal(stats["max"], values.max(0))
    np.testing.assert_allclose(stats["mean"], values.astype(float).mean(0), atol=1e-9)
    np.testing.assert_allclose(stats["std"], values.astype(float).std(0), atol=1e-5)
    assert stats["count"] == [len(values)]
    for percent in PERCENTILES:
        for column, got in zip(values.T, stats[f"q{percent:02d}"], strict=True):
            ranked = np.sort(column)
            assert got == next(
                x for k, x in enumerate(ranked, 1) if 100 * k >= percent * len(ranked)
            )


def test_scalar_columns_have_shape_one():
    assert {k: v.shape for k, v in vector_stats(np.arange(5)).items()} == dict.fromkeys(
        vector_stats(np.arange(5)), (1,)
    )


@given(hnp.arrays(np.uint8, (2, 4, 6, 3)))
def test_image_stats_are_those_of_the_pixels(frames):
    stats = image_stats(color_counts(list(frames)), 2)
    pixels = frames.reshape(-1, 3) / 255.0
    for name, value in (
        ("min", pixels.min(0)),
        ("max", pixels.max(0)),
        ("mean", pixels.mean(0)),
        ("std", pixels.std(0)),
    ):
        assert stats[name].shape == (3, 1, 1)
        np.testing.assert_allclose(stats[name].ravel(), value, atol=1e-7)
    np.testing.assert_allclose(
        stats["q50"].ravel(), np.quantile(pixels, 0.5, axis=0, method="inverted_cdf")
    )
    assert stats["count"] == [2]


def test_large_pictures_are_thinned_and_counts_add_up():
    frame = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
    counts = color_counts([frame])
    assert counts.sum() == 3 * 120 * 160
    np.testing.assert_array_equal(counts[0], np.bincount(frame[::2, ::2, 0].ravel(), minlength=256))


def test_rows_are_all_of_a_short_episode_and_spread_over_a_long_one():
    np.testing.assert_array_equal(sample_rows(7), np.arange(7))
    long = sample_rows(2000)
    assert (len(long), long[0], long[-1]) == (299, 0, 1999)

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.motion.workspace import Workspace, draw_within_reach

TABLE = Workspace(-0.35, 0.35, -0.25, 0.15)


def test_contains_counts_edges_and_honours_the_margin():
    points = [[0.35, 0.15, 0.76], [0.3501, 0, 0.76], [0, -0.2501, 0.76], [0.33, 0.0, 0.76]]
    assert TABLE.contains(points).tolist() == [True, False, False, True]
    assert TABLE.contains(points, margin=0.021).tolist() == [False, False, False, False]


@pytest.mark.parametrize(
    ("end", "guarded"),
    [
        ((0.1, 0.1), (-0.35, 0.33, -0.25, 0.13)),
        ((-0.1, 0.1), (-0.33, 0.35, -0.25, 0.13)),
        ((-0.1, -0.2), (-0.33, 0.35, -0.23, 0.15)),
        ((0.1, -0.2), (-0.35, 0.33, -0.23, 0.15)),
        ((0.345, 0.1), (-0.35, 0.345, -0.25, 0.13)),
    ],
)
def test_the_quadrant_of_the_end_guards_its_two_edges(end, guarded):
    area = TABLE.guarded(end)
    assert (area.x_min, area.x_max, area.y_min, area.y_max) == pytest.approx(guarded, abs=1e-12)


@given(st.floats(-0.35, 0.35), st.floats(-0.25, 0.15), st.floats(0, 0.1))
def test_the_guarded_area_is_a_part_of_the_workspace_and_holds_its_end(x, y, margin):
    area = TABLE.guarded((x, y), margin)
    assert area.contains((x, y))
    assert TABLE.contains([area.lower, area.upper]).all()


@pytest.mark.parametrize(
    ("centre", "radius"),
    [((0.0, -0.05), 0.1), ((0.35, 0.15), 0.2), ((-0.3, 0.0), 0.5), ((0.1, 0.1), 5.0)],
)
def test_points_within_reach_are_uniform_in_disc_and_rectangle(centre, radius):
    n = 4000
    points = draw_within_reach(np.random.default_rng(3), n, TABLE, centre, radius)
    assert TABLE.contains(points).all()
    assert (np.hypot(*(points - centre).T) <= radius).all()
    # the same share of the points falls left of the centre as of a fine grid over the same area
    grid = np.stack(
        np.meshgrid(np.linspace(-0.35, 0.35, 1401), np.linspace(-0.25, 0.15, 801)), -1
    ).reshape(-1, 2)
    grid = grid[np.hypot(*(grid - centre).T) <= radius]
    for axis in (0, 1):
        middle = np.median(grid[:, axis])
        share = (grid[:, axis] < middle).mean()
        assert abs((points[:, axis] < middle).mean() - share) < 4 * math.sqrt(0.25 / n)


@pytest.mark.parametrize(
    "edges", [(0.1, 0.1, 0, 1), (0, 1, 1, 0), (0, math.inf, 0, 1), (0, 1, math.nan, 1)]
)
def test_an_empty_or_infinite_workspace_is_refused(edges):
    with pytest.raises(ValueError, match="workspace"):
        Workspace(*edges)

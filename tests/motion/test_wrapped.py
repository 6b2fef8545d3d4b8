"""Motions that events change: their clock, their velocity, and what a file keeps of them."""

import numpy as np
import pytest

from pipeline.motion.models import motion_from_json
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.motion.wrapped import PUSHED, Change, changed

START = np.array([0.0, 0.0])


@pytest.fixture
def motion():
    """Along x at 0.1 m/s for 4 s."""
    piece = Segment(0.0, 4.0, np.array([[0.0, 0.4], [0.0, 0.0]]))
    return PlanarMotion(1, 0.1, 4.0, 0.0, 0.74, np.array([1.0, 0, 0, 0]), (piece,))


@pytest.mark.parametrize(
    ("changes", "ends"),
    [
        ([Change(1.0, 0.0)], 0.1),
        ([Change(1.0, -1.0)], 0.0),  # back at its start, where it stands
        ([Change(1.0, 2.0)], 0.5),
        ([Change(1.0, 0.0), Change(2.0, 1.0)], 0.2),
        ([Change(1.0, 1.0, 0.3, 0.0)], 0.3 + 0.3 * PUSHED),
    ],
)
def test_a_change_begins_where_the_motion_is(motion, changes, ends):
    new = motion
    for change in changes:
        new = changed(new, change)
    before = np.linspace(0.0, 1.0, 11)
    assert np.array_equal(new.pose(before), motion.pose(before))
    assert new.pose(3.0)[0] == pytest.approx(ends, abs=2e-3)
    times, h = np.array([1.4, 1.9, 2.3, 2.8]), 1e-6
    moved = (new.pose(times + h) - new.pose(times - h))[:, :3] / (2 * h)
    if ends:
        assert np.allclose(new.twist(times)[:, :3], moved, atol=1e-6)
    again = motion_from_json(new.to_json())
    assert again.pose(times).tobytes() == new.pose(times).tobytes()
    assert again.features() == motion.features()


def test_changes_that_are_none_are_refused(motion):
    text = changed(motion, Change(1.0, 0.0)).to_json()
    with pytest.raises(ValueError, match="changes"):
        motion_from_json(text.replace("[[1.0, 0.0, 0.0, 0.0]]", "[[1.0, 0.0]]"))

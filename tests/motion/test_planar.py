import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.motion.models import motion_from_json
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.poses import yawed
from tests.motion.jumps import velocity_jumps

YAW = yawed((0, 0, 0), 0.7)[3:]


@st.composite
def motions(draw):
    """Continuous motions of one to three pieces of any degree up to four."""
    lead, duration = draw(st.floats(0, 2)), draw(st.floats(0.5, 8))
    count = draw(st.integers(1, 3))
    shares = np.cumsum([draw(st.floats(0.2, 1)) for _ in range(count)])
    edges = [-lead, *(-lead + (lead + duration) * shares[:-1] / shares[-1]), duration]
    at = np.array([draw(st.floats(-0.3, 0.3)), draw(st.floats(-0.3, 0.3))])
    pieces = []
    for start, end in pairwise(edges):
        terms = draw(st.integers(0, 4))
        rest = np.array(
            [[draw(st.floats(-0.4, 0.4)) for _ in range(terms)] for _ in range(2)]
        ).reshape(2, terms)
        c = np.concatenate([at[:, None], rest], axis=1)
        pieces.append(Segment(float(start), float(end), c))
        at = c.sum(1)
    return PlanarMotion(3, 0.1, duration, lead, 0.76, YAW, tuple(pieces))


def corner():
    """Right for 2 s at 0.1 m/s, then away for 1 s at 0.2 m/s."""
    pieces = (
        Segment(0.0, 2.0, np.array([[0.0, 0.2], [0.0, 0.0]])),
        Segment(2.0, 3.0, np.array([[0.2, 0.0], [0.0, 0.2]])),
    )
    return PlanarMotion(3, 0.2, 3.0, 0.0, 0.8, YAW, pieces)


def test_a_motion_of_two_straight_pieces_in_closed_form():
    m = corner()
    np.testing.assert_allclose(
        m.position([-1, 0, 1, 2, 2.5, 3, 4.5]),
        [
            [0, 0, 0.8],
            [0, 0, 0.8],
            [0.1, 0, 0.8],
            [0.2, 0, 0.8],
            [0.2, 0.1, 0.8],
            [0.2, 0.2, 0.8],
            [0.2, 0.5, 0.8],
        ],
        atol=1e-15,
    )
    np.testing.assert_allclose(
        m.velocity([-1e-9, 0, 1.999, 2, 3, 9]),
        [[0, 0, 0], [0.1, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0.2, 0], [0, 0.2, 0]],
        atol=1e-15,
    )
    np.testing.assert_allclose(m.end_velocity, [0, 0.2, 0])
    assert m.breakpoints().tolist() == [2.0]
    np.testing.assert_allclose(velocity_jumps(m), [np.hypot(0.1, 0.2)], rtol=1e-6)
    assert m.average_speed() == pytest.approx(0.4 / 3)
    assert m.maximum_speed() == pytest.approx(0.2)
    np.testing.assert_allclose(m.extent(), [[0, 0], [0.2, 0.2]], atol=1e-15)


@given(motions(), st.floats(-3, 12))
def test_velocity_is_the_derivative_of_position(m, t):
    h = 1e-6
    corners = np.array([-m.lead, *m.breakpoints(), m.duration])
    if np.abs(corners - t).min() > 2 * h:
        slope = (m.position(t + h) - m.position(t - h)) / (2 * h)
        np.testing.assert_allclose(m.velocity(t), slope, atol=2e-7)


@given(motions())
def test_position_has_no_jumps(m):
    for t in [-m.lead, *m.breakpoints(), m.duration]:
        np.testing.assert_allclose(m.position(t - 1e-9), m.position(t + 1e-9), atol=1e-7)


@given(motions())
def test_average_maximum_and_extent_agree_with_brute_force(m):
    t = np.sort(np.concatenate([np.linspace(-m.lead, m.duration, 20001), m.breakpoints()]))
    p = m.position(t)
    assert m.average_speed() == pytest.approx(
        np.linalg.norm(np.diff(p, axis=0), axis=1).sum() / (m.lead + m.duration), abs=1e-4
    )
    speeds = np.linalg.norm(m.velocity(t), axis=-1)
    # at a breakpoint velocity(t) is the one after it; the one before it may be the largest
    before = np.linalg.norm(m.velocity(m.breakpoints() - 1e-9), axis=-1)
    brute = max(speeds.max(), before.max(initial=0.0))
    assert brute - 1e-6 <= m.maximum_speed() <= brute + 1e-2
    low, high = m.extent()
    np.testing.assert_allclose([low, high], [p[:, :2].min(0), p[:, :2].max(0)], atol=1e-5)


@given(motions())
def test_json_restores_every_bit(m):
    again = motion_from_json(m.to_json())
    assert again.to_json() == m.to_json()
    assert (again.level, again.alpha, again.duration, again.lead, again.z) == (
        m.level,
        m.alpha,
        m.duration,
        m.lead,
        m.z,
    )
    assert again.orientation.tobytes() == m.orientation.tobytes()
    for a, b in zip(again.segments, m.segments, strict=True):
        assert (a.start, a.end, a.coefficients.tobytes()) == (
            b.start,
            b.end,
            b.coefficients.tobytes(),
        )
    t = np.linspace(-3, 10, 57)
    assert again.pose(t).tobytes() == m.pose(t).tobytes()


def test_times_of_any_shape_are_answered_in_that_shape():
    m = corner()
    t = np.linspace(-1, 4, 24).reshape(2, 3, 4)
    assert m.pose(t).shape == (2, 3, 4, 7)
    assert m.velocity(t).shape == (2, 3, 4, 3)
    for index in np.ndindex(t.shape):
        np.testing.assert_array_equal(m.pose(t)[index], m.pose(t[index]))
        np.testing.assert_array_equal(m.velocity(t)[index], m.velocity(t[index]))
    np.testing.assert_array_equal(m.pose(1.0)[3:], YAW)


def test_a_still_target_stands():
    place = yawed((0.1, -0.2, 0.77), 1.2)
    m = PlanarMotion.still(place, 2.5, lead=0.5)
    t = np.linspace(-1, 9, 33)
    np.testing.assert_array_equal(m.pose(t), np.broadcast_to(place, (33, 7)))
    assert not m.velocity(t).any()
    assert (m.level, m.alpha, m.average_speed(), m.maximum_speed(), len(m.breakpoints())) == (
        0,
        0.0,
        0.0,
        0.0,
        0,
    )


def test_segments_must_cover_the_time():
    piece = Segment(0.0, 2.0, np.zeros((2, 1)))
    for duration, lead, segments in [
        (3.0, 0.0, (piece,)),
        (2.0, 1.0, (piece,)),
        (2.0, 0.0, ()),
        (2.0, 0.0, (piece, piece)),
    ]:
        with pytest.raises(ValueError, match="segment"):
            PlanarMotion(1, 0.1, duration, lead, 0.8, YAW, segments)
    with pytest.raises(ValueError, match="duration"):
        PlanarMotion(1, 0.1, 0.0, 0.0, 0.8, YAW, (piece,))
    with pytest.raises(ValueError, match="end after"):
        Segment(1.0, 1.0, np.zeros((2, 1)))
    with pytest.raises(ValueError, match="coefficients"):
        Segment(0.0, 1.0, np.zeros((3, 1)))


def test_a_motion_cannot_be_changed():
    m = corner()
    with pytest.raises(ValueError, match="read-only"):
        m.segments[0].coefficients[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        m.orientation[0] = 1.0


@pytest.mark.parametrize("broken", ["[]", "{}", "nonsense"])
def test_text_that_is_no_motion_is_refused(broken):
    with pytest.raises(ValueError, match=r"not a target motion|Expecting"):
        motion_from_json(broken)
    data = json.loads(corner().to_json())
    data["surprise"] = 1
    with pytest.raises(ValueError, match="surprise"):
        motion_from_json(json.dumps(data))

"""Metrics against hand calculation."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pipeline.data.episode.state_log import CONTACT_DTYPE, Event
from pipeline.evaluate.scoring.metrics import (
    jerk,
    manipulation_score,
    progress,
    route_completion,
    subgoals_reached,
    time_to_hold,
    touched_distractors,
)
from pipeline.world.physics.drive import Hold
from tests.synthetic import make_log

coordinate = st.floats(-1, 1, allow_nan=False)
point = st.tuples(coordinate, coordinate, coordinate)


def distance(a, b):
    return sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) ** 0.5


@given(point, point, point)
def test_progress_is_the_papers_ratio(start, end, goal):
    assume(distance(start, goal) >= 0.011)
    wanted = 1 - distance(end, goal) / distance(start, goal)
    assert progress(start, end, goal) == pytest.approx(min(max(wanted, 0), 1), abs=1e-9)


@given(point, point, point, point, point)
def test_route_completion_is_the_better_arms(l0, l1, r0, r1, goal):
    tools = np.array([[l0, r0], [(9, 9, 9)] * 2, [l1, r1]])
    best = max(progress(l0, l1, goal), progress(r0, r1, goal))
    assert route_completion(tools, goal, False) == pytest.approx(100 * best)
    assert route_completion(tools, goal, True) == 100


def test_constructed_approaches():
    goal = (0.3, 0.0, 0.8)
    assert progress((0, 0, 0.8), (0.15, 0, 0.8), goal) == pytest.approx(0.5)
    assert progress((0, 0, 0.8), (-1, 0, 0.8), goal) == 0
    assert progress((0, 0, 0.8), goal, goal) == 1
    # an arm that begins at the target
    assert progress(goal, (0.3, 0.04, 0.8), goal) == 1
    assert progress(goal, (0.3, 0.06, 0.8), goal) == 0.5


@given(st.floats(0, 100), st.booleans(), st.booleans())
def test_penalties_multiply(rc, away, clutter):
    expected = rc * (0.5 if away else 1) * (0.8 if clutter else 1)
    scored = manipulation_score(rc, out_of_bounds=away, clutter=clutter)
    assert scored == pytest.approx(expected)


def test_jerk_of_a_cubic_is_its_third_derivative():
    t = np.arange(20) / 15
    cubic = np.stack([2 * t**3, t**2, -(t**3)], -1)  # third derivative (12, 0, -6)
    assert jerk(cubic, 15) == pytest.approx(np.hypot(12, 6))
    assert jerk(cubic[:3], 15) == 0


def test_touched_distractors_are_those_of_the_events():
    log = make_log("aloha-agilex", 12, 15, 0)
    assert touched_distractors(log) == ()
    log.events = [
        Event("clutter_touched", 0.1, "clutter_2"),
        Event("meeting", 0.2, "left_link8"),
        Event("clutter_touched", 0.3, "clutter_1"),
    ]
    assert touched_distractors(log) == ("clutter_2", "clutter_1")


def test_a_hold_is_every_part_of_a_grip_at_two_frames_in_a_row():
    log = make_log("aloha-agilex", 12, 15, 0)
    hold = Hold(((frozenset({"left_hand"}), frozenset({"right_hand"})),))
    target, left, right = (log.bodies.index(name) for name in ("target", "left_hand", "right_hand"))
    # the left hand from frame 6 on, the right one at 7, and from 9 on: held alone at 7, in a row
    # from 9
    pairs = [(frame, left) for frame in range(6, 12)] + [(frame, right) for frame in (7, 9, 10, 11)]
    log.contacts = np.array(
        [(frame, target, hand, 0.1, (0, 0, 0), 1) for frame, hand in sorted(pairs)], CONTACT_DTYPE
    )
    log.events = [Event("meeting", 5.5 / 15)]
    assert time_to_hold(log, hold, "target") == pytest.approx(3.5 / 15)
    log.contacts = log.contacts[log.contacts["b"] == left]
    assert time_to_hold(log, hold, "target") is None


def test_a_subgoal_is_reached_where_none_of_its_conditions_is_missing():
    task = SimpleNamespace(subgoals={"first": ("first_in_bin",), "last": ("last_in_bin", "home")})
    assert subgoals_reached(task, ()) == {"first": True, "last": True}
    assert subgoals_reached(task, ("home", "other_left")) == {"first": True, "last": False}
    assert subgoals_reached(SimpleNamespace(subgoals={}), ("home",)) == {}

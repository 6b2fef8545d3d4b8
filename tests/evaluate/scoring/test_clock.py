"""Clock modes: how long the world goes on while a policy is asked."""

import numpy as np
import pytest

from pipeline.evaluate.scoring.clock import STEP_LOCKED_RATE, ClockError, parse_clock
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.motion.wrapped import Company, others_of

MOTION = PlanarMotion(
    1,
    0.1,
    2.0,
    0.0,
    0.74,
    np.array([1.0, 0, 0, 0]),
    (Segment(0.0, 2.0, np.array([[0.0, 0.2], [0.1, 0.0]])),),
)


def test_the_world_waits_for_nobody_but_a_slow_policy():
    assert parse_clock("sim").delay(9.0) == 0
    assert parse_clock("sim-clock").name == parse_clock("paused").name == "sim"
    assert parse_clock("120") == parse_clock("latency:120")
    assert parse_clock("step-locked").delay(9.0) == 0
    assert parse_clock("latency:120").delay(9.0) == pytest.approx(0.12)
    assert parse_clock("latency:measured").delay(0.31) == 0.31


@pytest.mark.parametrize(
    "text",
    [
        "",
        "sim:3",
        "latency",
        "latency:x",
        "latency:-1",
        "latency:normal:200:20",
        "late:measured",
        "async:rtc",
        "latency:nan",
        "late",
        "late:1:2",
    ],
)
def test_a_clock_that_is_none_is_refused_with_the_names_there_are(text):
    with pytest.raises(ClockError, match="step-locked, late:MS, latency:MS"):
        parse_clock(text)


def test_step_locked_targets_are_faster_by_the_documented_rate():
    fast = parse_clock("step-locked").motion(MOTION)
    t = np.array([0.0, 0.5, 1.1])
    np.testing.assert_allclose(fast.pose(t), MOTION.pose(t * 10 / 6))
    np.testing.assert_allclose(fast.twist(0.5), [0.1 / 0.6, 0, 0, 0, 0, 0])
    assert pytest.approx(1.67, abs=0.005) == STEP_LOCKED_RATE
    assert parse_clock("sim").motion(MOTION) is MOTION


def test_a_late_target_stands_first_and_then_does_the_same():
    late = parse_clock("late:400").motion(MOTION)
    np.testing.assert_allclose(late.pose(0.3), MOTION.pose(0.0))
    np.testing.assert_allclose(late.twist(0.3), np.zeros(6))
    np.testing.assert_allclose(late.pose(1.4), MOTION.pose(1.0))
    assert parse_clock("late:400").delay(9.0) == 0


def test_what_moves_beside_a_target_is_late_too():
    beside = others_of(parse_clock("late:400").motion(Company(MOTION, {"other": MOTION})))
    np.testing.assert_allclose(beside["other"].pose(1.4), MOTION.pose(1.0))

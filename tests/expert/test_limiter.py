"""What goes after a goal keeps the limits, arrives, and matches its velocity."""

import numpy as np
import pytest

from pipeline.data.clock import PHYSICS_HZ
from pipeline.expert.limiter import LAG, Limiter
from pipeline.planning.budgets import LIMITS


def follow(goals):
    limiter = Limiter(goals[0], np.array([1.4]), np.array([6.0]))
    velocities = np.diff(goals, axis=0, prepend=goals[:1]) * PHYSICS_HZ
    return np.array(
        [
            limiter.follow(goal, velocity)[0]
            for goal, velocity in zip(goals, velocities, strict=True)
        ]
    )


def differences(rows, n):
    return np.abs(np.diff(np.concatenate([rows[:1]] * 3 + [rows]), n, axis=0)).max() * PHYSICS_HZ**n


@pytest.mark.parametrize("jump", [0.01, 0.3, 2.0])
def test_a_goal_that_jumps_is_reached_within_the_limits_and_not_overshot(jump):
    goals = np.repeat([[0.0], [jump]], [16, 784], axis=0)
    rows = follow(goals)
    assert differences(rows, 1) <= 1.4 + 1e-9
    assert differences(rows, 2) <= 6.0 + 1e-6
    assert differences(rows, 3) <= LIMITS.jerk + 1e-4
    assert rows[-1, 0] == pytest.approx(jump, abs=1e-5)
    assert rows.max() < jump + 0.004


def test_a_goal_that_moves_evenly_is_followed_with_the_known_lag():
    t = np.arange(800) / PHYSICS_HZ
    rows = follow(0.2 * t[:, None])
    assert rows[-100:, 0] == pytest.approx(0.2 * (t[-100:] - LAG), abs=1e-6)

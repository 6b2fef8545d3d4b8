"""The filter against motions whose position and velocity are known."""

import numpy as np
import pytest

from pipeline.expert.reactive.prediction import TargetFilter
from pipeline.poses import quat_about, quat_rotate, yawed

PERIOD = 1 / 15


def watch(track: TargetFilter, positions, start: float = 0.0) -> TargetFilter:
    for n, position in enumerate(positions):
        track.see(start + n * PERIOD, yawed(position, 0.0))
    return track


def test_constant_velocity_seen_exactly_is_predicted_exactly():
    velocity = np.array([0.08, -0.05, 0.0])
    track = watch(TargetFilter(), [velocity * n * PERIOD for n in range(6)])
    assert track.velocity == pytest.approx(velocity, abs=1e-3)
    assert track.predict(2.0)[:3] == pytest.approx(velocity * 2.0, abs=2e-3)
    assert track.surprise < 1e-3


def test_an_abrupt_turn_is_a_surprise_and_is_followed_within_three_sightings():
    before, after = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.1, 0.0])
    track = watch(TargetFilter(), [before * n * PERIOD for n in range(8)])
    turn = before * 7 * PERIOD
    track.see(8 * PERIOD, yawed(turn + after * PERIOD, 0.0))
    assert track.surprise == pytest.approx(np.hypot(0.1, 0.1) * PERIOD, rel=0.02)
    watch(track, [turn + after * n * PERIOD for n in (2, 3)], 9 * PERIOD)
    assert track.velocity == pytest.approx(after, abs=0.01)


def test_with_noise_the_estimate_is_several_times_better_than_differences():
    rng, velocity, noise = np.random.default_rng(0), np.array([0.1, 0.05, 0.0]), 0.005
    errors, differences = [], []
    for _ in range(50):
        seen = [velocity * n * PERIOD + rng.normal(0, noise, 3) for n in range(20)]
        errors.append(watch(TargetFilter(noise), seen).velocity - velocity)
        differences.append((seen[-1] - seen[-2]) / PERIOD - velocity)
    assert np.std(errors) < 0.4 * np.std(differences)
    assert abs(np.mean(errors)) < 0.01


def test_a_target_that_turns_goes_on_turning():
    track = TargetFilter()
    for n in range(4):
        track.see(n * PERIOD, yawed((0.1, 0.0, 0.74), 0.3 * n * PERIOD))
    assert track.predict(1.0) == pytest.approx(yawed((0.1, 0.0, 0.74), 0.3), abs=1e-3)


def test_a_ball_that_rolls_is_expected_upright_where_its_centre_will_be():
    radius, speed = 0.03, 0.1
    track = TargetFilter(centre=(0.0, 0.0, radius))
    for n in range(6):
        t = n * PERIOD
        turned = quat_about((0, 1, 0), speed / radius * t)
        centre = np.array([speed * t, 0.0, 0.77])
        origin = centre - quat_rotate(turned, np.array([0.0, 0.0, radius]))
        track.see(t, np.concatenate([origin, turned]))
    later = track.predict(1.0)
    assert later == pytest.approx(yawed((speed, 0.0, 0.77 - radius), 0.0), abs=2e-3)


def test_a_ball_is_expected_upright_however_it_lies_when_it_is_first_seen():
    track = TargetFilter(ball=True)
    for n in range(3):
        track.see(n * PERIOD, np.concatenate([[0, 0, 0.77], quat_about((1, 0, 0), 2.0 + 0.01 * n)]))
    assert track.predict(1.0) == pytest.approx([0, 0, 0.77, 1, 0, 0, 0], abs=1e-6)

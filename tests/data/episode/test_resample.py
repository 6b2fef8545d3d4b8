"""A log at another rate: kept frames are exact, and the robot is driven alike."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.episode.resample import frames_at, resample_log
from pipeline.evaluate.actions import interpolate_targets
from tests.synthetic import make_log


def driven(log, fps):
    """Drive targets at every physics step, as the simulation sets them."""
    before, steps = log.state[0], 240 // fps
    rows = []
    for action in log.action[:-1]:
        rows.append(interpolate_targets(before, action, steps, 1 / fps)[0])
        before = action
    return np.concatenate(rows)


@pytest.mark.parametrize("rate", [5, 15, 30, 60, 80])
def test_kept_frames_are_exact_and_a_higher_rate_drives_alike(rate):
    log = make_log("franka-panda", 25, 15, 3)
    new = resample_log(log, 15, rate)
    assert np.allclose(np.diff(new.times), 1 / rate) and new.times[-1] <= log.times[-1] + 1e-9
    assert log.times[-1] - new.times[-1] < 1 / rate
    both = np.gcd(15, rate)
    for name in ("poses", "qpos", "qvel", "state", "tcp", "target_velocity"):
        ours, theirs = getattr(log, name)[:: 15 // both], getattr(new, name)[:: rate // both]
        assert np.array_equal(ours[: len(theirs)], theirs)
    assert np.allclose(np.linalg.norm(new.poses[..., 3:], axis=-1), 1)
    assert np.array_equal(
        new.action[rate // both - 1 :: rate // both][:3],
        log.action[15 // both - 1 :: 15 // both][:3],
    )
    if rate % 15 == 0:
        ours, theirs = driven(log, 15), driven(new, rate)
        length = min(len(ours), len(theirs))
        assert length > 300
        assert np.allclose(ours[:length], theirs[:length], atol=1e-12)


@pytest.mark.parametrize(
    ("rate", "frames", "impulses"),
    [
        (5, range(4), [0.1, 0.4, 0.7, 1.0]),
        (12, range(8), [0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 1.0]),
        (30, range(19), np.repeat(np.arange(1, 11), [1, *[2] * 9]) / 10),
        (20, range(13), [0.1, 0.2, 0.3, 0.4, 0.4, 0.5, 0.6, 0.7, 0.7, 0.8, 0.9, 1.0, 1.0]),
    ],
)
def test_a_touch_in_every_frame_stays_in_every_frame_with_the_largest_impulse(
    rate, frames, impulses
):
    log = make_log("franka-panda", 10, 15, 3)
    rows = np.repeat(log.contacts, 10)
    rows["frame"], rows["impulse"] = np.arange(10), np.arange(1, 11) / 10
    found = resample_log(replace(log, contacts=rows), 15, rate).contacts
    assert found["frame"].tolist() == list(frames)
    assert found["impulse"] == pytest.approx(np.array(impulses))


def test_a_rate_that_does_not_divide_the_physics_is_refused():
    assert frames_at(4, 15, 10).tolist() == [0, 1.5, 3]
    with pytest.raises(ValueError, match="do not divide 240"):
        frames_at(4, 15, 7)

"""A recorded episode of shake_bottle: what its state log says of velocities and of the arm agrees
with what happened."""

import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.data.recipe.model import Recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import quat_conjugate, quat_multiply, rotation_vector
from pipeline.stages.attempt import attempt

FPS = 60
PAGE = Path(__file__).parents[2] / "docs/fidelity.md"


@pytest.fixture(scope="module")
def log():
    """The state log of an accepted attempt at 60 frames a second."""
    spec = EpisodeSpec(
        "shake_bottle", "aloha-agilex", 1, 0.1, "clean", 0, 8282955658858097247, 5368980052149100341
    )
    return attempt(spec, Recipe(fps=FPS)).replay.log


def off(stated, rates):
    """Norms (T-2,) of the differences between what is stated and the central differences at all
    frames but first and last."""
    return np.linalg.norm(stated[1:-1] - rates, axis=-1)


def test_velocities_of_the_shaken_bottle_are_the_differences_of_its_pose(log):
    poses, released = log.pose("bottle"), log.time_of("release")
    moved = (poses[2:, :3] - poses[:-2, :3]) * FPS / 2
    turns = [
        quat_multiply(b, quat_conjugate(a))
        for a, b in zip(poses[:-2, 3:], poses[2:, 3:], strict=True)
    ]
    turned = np.array([rotation_vector(turn) for turn in turns]) * FPS / 2
    shaken = log.times[1:-1] > released
    assert np.linalg.norm(moved[shaken], axis=1).max() > 0.3
    assert np.linalg.norm(turned[shaken], axis=1).max() > 2.0
    assert np.median(off(log.target_velocity, moved)[shaken]) < 0.005
    assert np.quantile(off(log.target_velocity, moved), 0.95) < 0.01
    assert np.quantile(off(log.target_angular_velocity, turned), 0.95) < 0.05


def test_joints_are_as_fast_as_the_page_states_and_twice_as_fast_in_a_shake(log):
    stated = re.search(
        r"\| speed of the arms \| ([\d.]+) rad/s \(shaking ([\d.]+)\) and (\d+) rad/s",
        PAGE.read_text(),
    )
    assert stated
    usual, shaking, acceleration = map(float, stated.groups())
    (shake,) = (run for run in log.skills if run.skill == "shake")
    arm = [i for i, name in enumerate(log.vector_names) if not name.endswith("gripper")]
    rates = np.abs(np.diff(log.action[:, arm], axis=0)).max(1) * FPS
    within = (log.times[1:] > shake.start / 240) & (log.times[:-1] < shake.end / 240)
    assert 0.9 * usual < rates[~within].max() <= usual * (1 + 1e-5)
    assert usual < rates[within].max() <= shaking * (1 + 1e-5)
    assert (
        0.5 * acceleration
        < np.abs(np.diff(log.action[:, arm], 2, axis=0)).max() * FPS**2
        <= acceleration * (1 + 1e-5)
    )


def test_an_episode_ends_after_a_rest_of_0_4_s(log):
    rested = log.times[-1] - max(run.end for run in log.skills) / 240
    assert 0.4 <= rested <= 0.4 + 1 / FPS


def test_velocities_of_the_joints_are_the_differences_of_their_positions(log):
    rates = (log.qpos[2:] - log.qpos[:-2]) * FPS / 2
    assert np.abs(rates).max() > 2.0
    assert np.quantile(np.abs(log.qvel[1:-1] - rates).max(1), 0.95) < 0.05


def test_an_attempt_with_imperfect_drives_repeats_and_its_joints_are_off_by_what_was_asked():
    spec = EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 3)
    recipe = Recipe(drive={"noise": 0.002})
    logs = [attempt(spec, recipe).replay.log for _ in range(2)]
    assert (
        logs[0].poses.tobytes() == logs[1].poses.tobytes()
        and logs[0].action.tobytes() == logs[1].action.tobytes()
    )
    arm = [i for i, name in enumerate(logs[0].vector_names) if not name.endswith("gripper")]
    off = logs[0].state[8:, arm] - logs[0].action[7:-1, arm]
    assert np.sqrt((off**2).mean()) == pytest.approx(0.002, rel=0.25)
    exact = attempt(spec, Recipe()).replay.log
    assert np.abs(exact.state[1:, arm] - exact.action[:-1, arm]).mean() < 0.0005

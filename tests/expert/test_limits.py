"""Limits of velocity, acceleration and jerk, read back from what episodes command at every physics
step."""

from dataclasses import asdict

import numpy as np
import pytest

from benchmarks.limits import fill, shares
from pipeline.data.recipe.model import Recipe
from pipeline.world.physics.contacts import FORCES
from pipeline.world.robots import get_embodiment

PRESS = 30.0
"""N: the most a finger presses with."""


@pytest.mark.parametrize(
    ("task", "robot", "expert"),
    [
        ("shake_bottle", "franka-panda", "planned"),  # the fastest joints of all
        ("click_bell", "piper", "reactive"),  # the hardest press
        ("grab_roller", "aloha-agilex", "planned"),  # both arms at once, stretched to end together
        ("press_stapler", "ur5-wsg", "planned"),
        ("handover_block", "franka-panda", "planned"),  # the receiving hand is near the table
        ("put_can_pot", "arx-x5", "planned"),  # a plan and the target's motion, added
        ("catch_tossed_ball", "aloha-agilex", "reactive"),
    ],
)
def test_no_sample_of_an_episode_exceeds_a_limit_of_motion_or_force(
    task: str, robot: str, expert: str
) -> None:
    recipe = Recipe.model_validate(
        {"tasks": [task], "embodiments": [robot], "levels": [1], "episodes": 1, "expert": expert}
    )
    worst = fill((recipe, next(iter(recipe.slots()))))
    assert worst is not None
    for kind in ("velocity", "acceleration", "jerk"):
        assert 0.3 < worst.values[kind] < 1 + 1e-5, kind
    assert worst.values["press"] < PRESS
    for kind, most in asdict(FORCES).items():
        assert worst.values[kind] <= most, kind
    assert all(way.length >= way.straight - 1e-9 for way in worst.ways) and worst.ways
    assert (worst.values["press"] > 1) == (task in ("click_bell", "press_stapler"))


def test_shares_are_those_of_a_known_motion() -> None:
    robot = get_embodiment("franka-panda")
    t = np.arange(241) / 240
    commands = np.zeros((len(t), 16))
    # at rest at both ends but for a jump of acceleration
    commands[:, 0] = 0.1 * 0.5 * (1 - np.cos(2 * np.pi * 3 * t))
    found, w = shares(robot, commands), 2 * np.pi * 3
    assert found["velocity"] == pytest.approx(0.05 * w / 2.175, rel=2e-3)
    assert found["acceleration"] == pytest.approx(0.05 * w**2 / 6, rel=1e-2)
    # half of that jump within one sample
    assert found["jerk"] == pytest.approx(0.5 * 0.05 * w**2 * 240 / 240, rel=0.05)
    # a jaw of 4 cm, from rest to speed within one sample
    commands[:, 0], commands[:, 7] = 0.0, np.linspace(0, 1, len(t))
    assert shares(robot, commands)["acceleration"] == pytest.approx(
        0.04 / (len(t) - 1) * 240**2 / 6
    )

"""Fingertips that press stop where they touch the target."""

import numpy as np
import pytest

from pipeline.expert.budgets import TIMING
from pipeline.expert.skills import close, press
from pipeline.poses import quat_rotate
from tests.expert.simulated import actor_among, body


@pytest.mark.parametrize("family", ["bell", "alarm_clock"])
def test_a_press_ends_at_the_touch_and_leaves_the_target_standing(family: str) -> None:
    actor = actor_among(body("target", family, 0.15, -0.1))
    for skill in (close("right"), press("right", actor.frame("target", "button"), depth=0.012)):
        actor.perform(skill)
    touched = next(event.time for event in actor.simulation.events if event.name == "meeting")
    # on the way down until the touch is seen, then at rest for as long as fingertips stay on what they press
    assert actor.simulation.time - touched < TIMING.press + 0.1
    tip = actor.tcp("right")[2]
    actor.wait(0.5)
    assert actor.tcp("right")[2] == pytest.approx(tip)
    still = actor.pose("target")
    assert np.linalg.norm(still[:2] - actor.bodies["target"].pose[:2]) < 0.005
    assert quat_rotate(still[3:], np.array([0.0, 0.0, 1.0]))[2] > 0.99

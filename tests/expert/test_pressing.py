"""Fingertips that press come down softly and stop where they touch the target."""

import numpy as np
import pytest

from benchmarks.limits import watched
from pipeline.expert.budgets import PRESS, TIMING
from pipeline.expert.skills import close, press
from pipeline.poses import quat_rotate
from tests.expert.simulated import actor_among, body


@pytest.mark.parametrize(
    ("family", "part"), [("bell", "button"), ("alarm_clock", "button"), ("stapler", "press")]
)
def test_a_press_ends_at_the_touch_and_leaves_the_target_standing(family: str, part: str) -> None:
    actor = actor_among(body("target", family, 0.15, -0.1))
    with watched() as steps:
        for skill in (close("right"), press("right", actor.frame("target", part), depth=0.012)):
            actor.perform(skill)
    touched = next(event.time for event in actor.simulation.events if event.name == "meeting")
    # creeping a fraction of a millimetre beyond the touch, then at rest for as long as fingertips
    # stay on what they press
    assert actor.simulation.time - touched < TIMING.press + 0.15
    tip = actor.tcp("right")[2]
    at_touch = actor.planner.fk(
        "right", actor.planner.split(steps.commands[round(touched * 240)])["right"][0]
    )[2]
    assert 0 < at_touch - tip < 2 * PRESS.squeeze
    strongest = [
        max(
            (force for pair, force in now.items() if pair[0] == "target" != pair[1] != "table"),
            default=0.0,
        )
        for now in steps.forces
    ]
    assert 2 < max(strongest) < 30
    assert sum(force > 0 for force in strongest) > 0.9 * TIMING.press * 240  # it does not bounce
    actor.wait(0.5)
    assert actor.tcp("right")[2] == pytest.approx(tip)
    still = actor.pose("target")
    assert np.linalg.norm(still[:2] - actor.bodies["target"].pose[:2]) < 0.005
    assert quat_rotate(still[3:], np.array([0.0, 0.0, 1.0]))[2] > 0.99

"""Two hands bring what they hold to each other; a lift ends where nothing is touched."""

import numpy as np
import pytest

from pipeline.expert.actor import Actor
from pipeline.expert.skills import face, grasp, lift, lift_clear
from pipeline.planning.failure import PlanFailure
from pipeline.poses import pose, quat_about, yawed
from pipeline.world.physics.body import TABLE_TOP
from tests.expert.simulated import actor_among, body

FAR = pose((0.0, 3.0, 0.8))
UP = TABLE_TOP + 0.18


@pytest.fixture(scope="module")
def holding() -> Actor:
    """A can in the left hand and a block in the right one, both off the table."""
    actor = actor_among(body("can", "can", -0.2, -0.1), body("block", "block", 0.2, -0.1))
    for side, name in (("left", "can"), ("right", "block")):
        for skill in (grasp(side, name), lift(side, 0.1)):
            actor.perform(skill)
    return actor


def test_nothing_is_shown_that_the_other_arm_cannot_come_to(holding: Actor) -> None:
    steps = holding.simulation.steps
    with pytest.raises(PlanFailure, match="facing_blocked"):
        holding.perform(face("left", yawed((-0.1, -0.1, UP), 0.0), "right", lambda _: FAR[None]))
    assert holding.simulation.steps == steps


def test_the_body_is_shown_where_the_other_arm_comes_to_it(holding: Actor) -> None:
    places = np.stack([yawed((-0.12, y, UP), 0.0) for y in (-0.05, -0.15)])

    def beside(can: np.ndarray) -> np.ndarray:
        """Out of reach beside the first place, 20 cm beside the other."""
        return np.stack(
            [
                FAR if can[1] > -0.1 else yawed((can[0] + 0.2, can[1], UP), turn)
                for turn in (0.0, np.pi)
            ]
        )

    holding.perform(face("left", places, "right", beside))
    np.testing.assert_allclose(holding.pose("can")[:3], places[1, :3], atol=0.01)
    np.testing.assert_allclose(
        holding.pose("block")[:3], np.add(holding.pose("can")[:3], (0.2, 0, 0)), atol=0.015
    )


def test_a_lift_ends_below_what_is_in_the_way() -> None:
    actor = actor_among(body("can", "can", -0.03, -0.1))
    actor.perform(grasp("left", "can"))
    before = actor.tcp("left")[2]
    # the other hand is expected above, level and facing this arm
    x, y, z = actor.tcp("left")[:3]
    above = pose((x, y, z + 0.26), quat_about((0, 0, 1), np.pi))
    q, ok = actor.arm_planner("right").solve(above[None])
    assert ok[0]
    actor.expected["right"] = q[0]
    actor.perform(lift_clear("left", 0.10))
    assert 0.01 < actor.tcp("left")[2] - before < 0.09

"""What the expert tells the planner, and how planned motion steps are executed."""

import numpy as np
import pytest

from pipeline.expert.actor import Actor
from pipeline.planning.failure import PlanFailure
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import compose
from tests.expert.simulated import actor_among, body

CAN, BALL = body("can", "can", 0.2, 0.0), body("block", "block", -0.2, 0.1)


@pytest.fixture
def actor() -> Actor:
    return actor_among(CAN, BALL)


def moved(actor: Actor, side: str, by: float, rows: int) -> ArmTrajectory:
    """The first joint turns by `by` rad at an even pace while the jaws close."""
    q = np.repeat(actor.q(side)[None], rows, axis=0)
    q[:, 0] += np.linspace(0, by, rows)
    return ArmTrajectory(q, np.zeros_like(q), np.linspace(1.0, 0.0, rows))


def test_the_scene_holds_what_is_commanded_and_measured(actor: Actor) -> None:
    actor.execute({"right": moved(actor, "right", 0.3, 30)})
    scene = actor.planning_scene()
    command = actor.simulation.command
    np.testing.assert_array_equal(scene.arms["left"].q, command[:6])
    np.testing.assert_array_equal(scene.arms["right"].q, command[7:13])
    assert scene.arms["right"].q[0] == command[7] != 0.0
    assert (scene.arms["left"].gripper, scene.arms["right"].gripper) == (1.0, 0.0)
    assert list(scene.obstacles) == ["can", "block"] and not scene.carried
    for name, obstacle in scene.obstacles.items():
        np.testing.assert_array_equal(obstacle.pose, actor.simulation.pose(name))
        assert obstacle.pieces == actor.bodies[name].instance.shape().collision


def test_the_scene_stays_as_it_was_when_the_actor_goes_on(actor: Actor) -> None:
    scene = actor.planning_scene()
    before = scene.arms["right"].q.copy()
    actor.execute({"right": moved(actor, "right", 0.3, 30)})
    np.testing.assert_array_equal(scene.arms["right"].q, before)
    assert scene.arms["right"].gripper == 1.0 and actor.gripper("right") == 0.0
    actor.simulation.command[7] += 1.0
    np.testing.assert_array_equal(scene.arms["right"].q, before)


def test_a_held_body_is_carried_at_its_measured_place_in_the_hand(actor: Actor) -> None:
    actor.held["right"] = "can"
    scene = actor.planning_scene()
    assert list(scene.obstacles) == ["block"] and list(scene.carried) == ["can"]
    carried = scene.carried["can"]
    assert carried.side == "right" and carried.pieces == CAN.instance.shape().collision
    np.testing.assert_allclose(
        compose(actor.simulation.tcp("right"), carried.pose), actor.pose("can"), atol=1e-7
    )
    actor.held = {"left": "can", "right": "can"}  # handed over: the arm that took it last has it
    assert actor.planning_scene().carried["can"].side == "right"


def test_the_other_arm_is_expected_where_it_is_about_to_be(actor: Actor) -> None:
    for side in ("left", "right"):
        np.testing.assert_array_equal(actor.planning_scene().arms[side].expected, actor.q(side))
    about = actor.q("left") + 0.2
    actor.expected["left"] = about
    arms = actor.planning_scene().arms
    np.testing.assert_array_equal(arms["left"].expected, about)
    np.testing.assert_array_equal(arms["left"].q, actor.q("left"))
    np.testing.assert_array_equal(arms["right"].expected, actor.q("right"))


def test_what_lies_loose_in_another_body_is_no_obstacle() -> None:
    bin_ = body("bin", "table_bin", 0.1, 0.0)
    actor = actor_among(bin_, body("ball", "ball", 0.1, 0.0, inside="bin"))
    assert list(actor.planning_scene().obstacles) == ["bin"]


def test_an_arm_planner_starts_from_the_command_of_its_arm(actor: Actor) -> None:
    actor.execute({"right": moved(actor, "right", 0.3, 30)})
    arm = actor.arm_planner("right")
    np.testing.assert_array_equal(arm.q, actor.q("right"))
    np.testing.assert_array_equal(arm.fk(arm.q), actor.tcp("right"))
    assert arm.gripper == 0.0 and arm.rng is actor.rng


WINDOW = 12
"""Rows over which commands are averaged: 2 * 6 rad/s2 / 240 rad/s3 at 240 Hz."""


def test_a_motion_step_lasts_as_long_as_its_longer_trajectory_and_the_average_over_it(
    actor: Actor,
) -> None:
    began, still = actor.simulation.steps, actor.q("left").copy()
    short, long = moved(actor, "left", 0.1, 10), moved(actor, "right", 0.2, 25)
    actor.execute({"left": short, "right": long})
    assert actor.simulation.steps - began == len(actor.stream.commands) == 25 + WINDOW - 1
    commands, rates = np.array(actor.stream.commands), np.array(actor.stream.velocities)
    np.testing.assert_allclose(
        commands[10 + WINDOW - 1 :, :6], np.repeat(short.q[-1:], 15, axis=0), rtol=0, atol=1e-15
    )
    for column, rows in ((0, short.q), (7, long.q)):
        raw = np.concatenate(
            [np.full(WINDOW - 1, still[0]), rows[:, 0], np.full(WINDOW - 1, rows[-1, 0])]
        )
        want = np.convolve(raw, np.full(WINDOW, 1 / WINDOW), "valid")
        np.testing.assert_allclose(commands[: len(want), column], want, atol=1e-14)
    np.testing.assert_array_equal(commands[-1, 7:13], long.q[-1])
    np.testing.assert_allclose(rates[:, 6], np.diff(commands[:, 6], prepend=1.0) * 240, atol=1e-9)


def test_a_hold_at_the_end_of_a_motion_takes_up_the_average(actor: Actor) -> None:
    moving = moved(actor, "right", 0.1, 20)
    assert len(actor.commands({"right": moving.holding(0.1)})[0]) == 20 + 24
    still = ArmTrajectory(actor.q("right")[None], np.zeros((1, 6)), np.ones(1)).holding(0.1)
    np.testing.assert_array_equal(
        actor.commands({"right": still})[0], np.repeat(actor.simulation.command[None], 25, axis=0)
    )


def test_the_step_limit_ends_a_motion() -> None:
    actor = actor_among(CAN, step_limit=1)
    with pytest.raises(PlanFailure, match="step_limit: 16 physics steps were not enough"):
        actor.execute({"right": moved(actor, "right", 0.1, 17)})
    assert len(actor.stream.commands) == 16

"""Two arms at once: motion steps that end together, and turns where the arms would meet."""

from collections.abc import Iterator

import numpy as np
import pytest

from pipeline.expert.actor import Actor, MotionStep, Skill
from pipeline.expert.skills import lift, pause, together
from pipeline.planning.failure import PlanFailure
from pipeline.planning.trajectory import ArmTrajectory
from pipeline.poses import pose, quat_about
from tests.expert.simulated import actor_among, body

MIDDLE = pose((0.0, -0.1, 1.0), quat_about((0, 0, 1), np.pi / 2))


@pytest.fixture
def actor() -> Actor:
    return actor_among(body("can", "can", 0.0, 0.3))


def to_joints(side: str, *goals: np.ndarray, begin: float = 0.0, end: float = 1.0) -> Skill:
    """One motion step of 100 rows to each of some joints, whatever is there: it moves between two
    fractions of the time."""

    def act(a: Actor) -> Iterator[MotionStep]:
        for goal in goals:
            share = np.clip((np.linspace(0, 1, 101)[1:, None] - begin) / (end - begin), 0, 1)
            q = a.q(side) + share * (goal - a.q(side))
            yield {side: ArmTrajectory(q, np.zeros_like(q), np.ones(100))}

    return act


def test_trajectories_are_stretched_to_end_together(actor: Actor) -> None:
    (step,) = together(lift("left", 0.03), lift("right", 0.09))(actor)
    (left,), (right,) = (
        list(lift(side, height)(actor)) for side, height in (("left", 0.03), ("right", 0.09))
    )
    assert (
        len(left["left"].q) < len(right["right"].q) == len(step["left"].q) == len(step["right"].q)
    )
    np.testing.assert_array_equal(step["right"].q, right["right"].q)
    np.testing.assert_array_equal(step["left"].q[-1], left["left"].q[-1])
    stretch = len(step["left"].q) / len(left["left"].q)
    assert (
        np.abs(np.diff(step["left"].q, axis=0)).max() * stretch
        <= 1.01 * np.abs(np.diff(left["left"].q, axis=0)).max()
    )


def test_an_arm_that_stands_still_waits(actor: Actor) -> None:
    (step,) = together(pause("left", 0.1), lift("right", 0.05))(actor)
    assert len(step["left"].q) == len(step["right"].q) > 25
    assert (step["left"].q == actor.q("left")).all() and (step["left"].gripper == 1.0).all()


def test_the_rest_of_a_longer_skill_goes_on_alone(actor: Actor) -> None:
    home = actor.q("left")
    longer, shorter = (
        to_joints("left", home + 0.05, home),
        to_joints("right", actor.q("right") + 0.05),
    )
    assert [set(step) for step in together(longer, shorter)(actor)] == [{"left", "right"}, {"left"}]
    assert not actor.expected


def test_arms_that_would_collide_are_refused(actor: Actor) -> None:
    middle = {}
    for side in ("left", "right"):
        q, ok = actor.arm_planner(side).solve(MIDDLE[None])
        assert ok[0]
        middle[side] = q[0]
    with pytest.raises(PlanFailure, match="arms_collide: the arms would touch each other"):
        list(
            together(to_joints("left", middle["left"]), to_joints("right", middle["right"]))(actor)
        )


def test_arms_take_turns_where_only_the_motions_collide(actor: Actor) -> None:
    middle = {side: actor.arm_planner(side).solve(MIDDLE[None])[0] for side in ("left", "right")}
    home = actor.q("left").copy()
    actor.execute({"left": ArmTrajectory(middle["left"], np.zeros((1, 6)), np.ones(1))})
    soon, late = to_joints("right", middle["right"][0], end=0.5), to_joints("left", home, begin=0.5)
    assert [list(step) for step in together(soon, late)(actor)] == [["left"], ["right"]]
    late, soon = to_joints("right", middle["right"][0], begin=0.5), to_joints("left", home, end=0.5)
    assert [list(step) for step in together(late, soon)(actor)] == [["right", "left"]]

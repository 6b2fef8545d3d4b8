"""A hand that tracks keeps its pose relative to the moving target, keeps the limits, and comes to
rest after the meeting."""

import numpy as np
import pytest

from pipeline.data.clock import PHYSICS_HZ
from pipeline.data.episode.state_log import SkillRun
from pipeline.expert.tracking import carried_along
from pipeline.planning.budgets import LIMITS
from pipeline.planning.failure import PlanFailure
from pipeline.planning.planner import planner_of
from pipeline.poses import angle_between, compose, inverse, transform, yawed
from pipeline.world.robots import get_embodiment

RUN = SkillRun("track", ("left",), "pot", "", "meet", 0, 480)
REACHING = [0.0, 1.6, 1.3, 0.4, 0.0, 0.0]  # the elbow bent, far from any singular posture


def target(before, after=None, turns=0.0):
    """Along x at `before` m/s, from 1 s on at `after`; it turns about the vertical at `turns`
    rad/s."""

    def at(t):
        t, change = np.asarray(t, float), 0.0 if after is None else after - before
        x = before * t + change * np.maximum(t - 1.0, 0.0)
        spots = zip(np.ravel(x), np.ravel(t), strict=True)
        poses = np.array([yawed((-0.1 + by, -0.1, 0.74), turns * at) for by, at in spots])
        return poses.reshape(*t.shape, 7)

    return at


@pytest.fixture(scope="module")
def plan():
    """An arm that rests where it is, then approaches by a turn of its first joint from row 240 on:
    within the limits."""
    planner = planner_of(get_embodiment("aloha-agilex"))
    at = np.concatenate([[*REACHING, 1.0], [*planner.home("right"), 1.0]])
    commands = np.tile(at, (480, 1))
    commands[240:360, 0] += 0.05 * (1 - np.cos(np.linspace(0, np.pi, 120))) / 2
    commands[360:, 0] += 0.05
    return planner, commands, np.gradient(commands, 1 / PHYSICS_HZ, axis=0), len(REACHING)


def test_the_hand_moves_as_the_target_does_from_its_approach_to_the_meeting(plan):
    planner, commands, velocities, n = plan
    motion = target(0.05)
    found, _ = carried_along(planner, (commands, velocities), RUN, motion, 359)
    at = motion(np.array([1.5]))[0]
    for row in (256, 304, 359):
        moved = compose(
            motion(np.array((row + 1) / 240)),
            compose(inverse(at), planner.fk("left", commands[row, :n])),
        )
        np.testing.assert_allclose(planner.fk("left", found[row, :n])[:3], moved[:3], atol=5e-4)
    np.testing.assert_array_equal(found[:480, n:], commands[:, n:])
    np.testing.assert_array_equal(found[480:, n:], commands[-1:, n:].repeat(len(found) - 480, 0))
    np.testing.assert_allclose(found[359], commands[359], atol=2e-3)


@pytest.mark.parametrize("motion", [target(0.05), target(0.1), target(0.1, -0.1)])
def test_the_sum_of_plan_and_target_keeps_the_limits_and_ends_at_rest(plan, motion):
    planner, commands, velocities, n = plan
    found, rates = carried_along(planner, (commands, velocities), RUN, motion, 359)
    still = np.concatenate([commands[:1].repeat(3, 0), found, found[-1:].repeat(3, 0)])[:, :n]
    speed, acceleration, jerk = (
        np.abs(np.diff(still, k, axis=0)).max() * PHYSICS_HZ**k for k in (1, 2, 3)
    )
    assert 0.02 < speed <= 1.4 + 1e-9
    assert acceleration <= 6.0 + 1e-6
    assert jerk <= LIMITS.jerk * 1.001
    np.testing.assert_allclose(rates[1:, :n], np.diff(found[:, :n], axis=0) * PHYSICS_HZ, atol=1e-9)


def test_a_target_out_of_reach_is_refused(plan):
    planner, commands, velocities, _ = plan
    with pytest.raises(PlanFailure, match="move along"):
        carried_along(planner, (commands, velocities), RUN, target(2.0), 359)


def test_a_target_that_turns_just_before_the_meeting_is_refused(plan):
    planner, commands, velocities, _ = plan
    with pytest.raises(PlanFailure, match="mm late"):
        carried_along(planner, (commands, velocities), RUN, target(0.4, -0.4), 250)


def test_a_hand_that_would_follow_the_target_into_the_other_arm_is_refused(plan):
    planner, commands, velocities, n = plan
    apart = planner.world.between_arms({})
    beside = commands.copy()
    beside[:, 0] -= 0.5  # over the middle of the table, where the other arm comes near
    for turn in np.linspace(0.0, 1.0, 60):
        nearer = [turn, *REACHING[1:]]
        if apart.first_blocked(beside[:, :n], np.array([nearer])) is not None:
            break
        beside[:, n + 1 : -1] = nearer
    carried_along(planner, (beside, velocities), RUN, target(0.0), 359)
    motion = target(-0.1)
    with pytest.raises(PlanFailure, match="arms_collide"):
        carried_along(planner, (beside, velocities), RUN, motion, 359)


def test_a_hand_follows_the_point_that_it_is_to_meet_and_does_not_turn(plan):
    """A target that turns as fast as a pot on the table would turn the wrist beyond its limits."""
    planner, commands, velocities, n = plan
    motion, row = target(0.0, turns=0.3), 304
    found, _ = carried_along(planner, (commands, velocities), RUN, motion, 359)
    touch, at = (planner.fk("left", commands[k, :n]) for k in (359, row))
    spot = transform(inverse(motion(np.array(1.5))), touch[:3])
    by = transform(motion(np.array((row + 1) / 240)), spot) - touch[:3]
    tcp = planner.fk("left", found[row, :n])
    np.testing.assert_allclose(tcp[:3], at[:3] + by, atol=1e-3)
    assert np.linalg.norm(by) > 0.01 and angle_between(tcp[3:], at[3:]) < 0.01

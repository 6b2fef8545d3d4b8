"""Which grasp is chosen, what the plan promises, and why there may be none."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.expert.actor import Actor
from pipeline.expert.budgets import GRASP
from pipeline.expert.candidates import GraspOptions, backed_off
from pipeline.expert.grasping import plan_grasp
from pipeline.planning.failure import PlanFailure
from pipeline.poses import compose, inverse, lifted, pose, quat_rotate
from tests.expert.simulated import actor_among, body


@pytest.fixture(scope="module")
def actor() -> Actor:
    return actor_among(body("can", "can", 0.2, 0.0), body("block", "block", -0.2, 0.1))


def test_the_plan_leads_from_the_command_to_an_annotated_grasp(actor: Actor) -> None:
    plan = plan_grasp(actor, "right", "can", GraspOptions())
    arm = actor.arm_planner("right")
    annotated = [compose(actor.pose("can"), grasp.pose) for grasp in actor.frames("can").grasps]
    assert min(np.linalg.norm(plan.tcp[:3] - tcp[:3]) for tcp in annotated) < 1e-9
    np.testing.assert_allclose(plan.to_standoff.q[-1], plan.line[0], atol=2e-3)
    np.testing.assert_allclose(
        arm.fk(plan.line[0])[:3], backed_off(plan.tcp, GRASP.standoff)[:3], atol=2e-4
    )
    np.testing.assert_allclose(arm.fk(plan.line[-1])[:3], plan.tcp[:3], atol=2e-4)
    assert np.abs(plan.to_standoff.q[0] - actor.q("right")).max() < 0.01


@pytest.mark.parametrize("pitch", [0.5, 1.4])
def test_the_preferred_pitch_decides_among_equals(actor: Actor, pitch: float) -> None:
    def chosen(wanted: float) -> float:
        x_axis = quat_rotate(
            plan_grasp(actor, "right", "can", GraspOptions(pitch=wanted)).tcp[3:], [1.0, 0, 0]
        )
        return float(np.arcsin(-x_axis[2]))

    other = 1.9 - pitch
    assert abs(chosen(pitch) - pitch) < abs(chosen(other) - pitch)


def test_no_approach_is_steeper_than_asked(actor: Actor) -> None:
    plan = plan_grasp(actor, "right", "can", GraspOptions(pitch=1.4, steepest=0.6))
    assert -quat_rotate(plan.tcp[3:], [1.0, 0, 0])[2] <= np.sin(0.6) + 1e-6


def test_a_goal_must_be_reachable_with_the_same_grasp(actor: Actor) -> None:
    near = lifted(actor.pose("can"), 0.1)
    plan = plan_grasp(actor, "right", "can", GraspOptions(goals=[[near]]))
    in_hand = compose(inverse(plan.tcp), actor.pose("can"))
    assert actor.arm_planner("right").solve(compose(near, inverse(in_hand))[None])[1][0]
    with pytest.raises(
        PlanFailure, match="grasp_unreachable: no grasp of can is in reach of the right arm"
    ):
        plan_grasp(actor, "right", "can", GraspOptions(goals=[[pose((0.0, 3.0, 0.8))]]))


def test_leading_refuses_grasps_whose_hand_would_touch_the_table_at_the_goal(actor: Actor) -> None:
    options = GraspOptions(goals=[[lifted(actor.pose("can"), -0.1)]])
    assert len(plan_grasp(actor, "right", "can", options).line)
    with pytest.raises(PlanFailure, match="grasp_blocked"):
        plan_grasp(actor, "right", "can", replace(options, leading=40))


def test_reasons_why_there_is_no_grasp(actor: Actor) -> None:
    with pytest.raises(PlanFailure, match="no_grasp: can offers no grasp of kind"):
        plan_grasp(actor, "right", "can", GraspOptions(kinds=("no such kind",)))
    far = actor_among(replace(body("can", "can", 0.0, 0.0), pose=pose((0.0, 2.5, 0.74))))
    with pytest.raises(PlanFailure, match="grasp_unreachable"):
        plan_grasp(far, "right", "can", GraspOptions())


def test_backing_off_moves_against_the_approach_axis() -> None:
    tcp = pose((0.1, 0.2, 0.9), (0.7, 0.1, -0.5, 0.3))
    np.testing.assert_allclose(
        backed_off(tcp, 0.05)[:3], tcp[:3] - 0.05 * quat_rotate(tcp[3:], [1.0, 0, 0]), atol=1e-15
    )
    np.testing.assert_array_equal(backed_off(tcp, 0.05)[3:], tcp[3:])
    np.testing.assert_allclose(lifted(tcp, 0.05) - tcp, [0, 0, 0.05, 0, 0, 0, 0], atol=1e-15)

"""Where a body is set down between two grasps, and what is done when a skill cannot be planned."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.episode.state_log import SkillRun
from pipeline.expert.actor import Actor
from pipeline.expert.budgets import SEAT
from pipeline.expert.scripts import find_seats, promising, regrasp
from pipeline.expert.skills import first_of, grasp, in_turn, lift, move, open_
from pipeline.planning.failure import PlanFailure
from pipeline.poses import pose, yawed
from pipeline.world.objects.families.containers.tableware import Bowl
from pipeline.world.physics.body import TABLE_TOP
from tests.expert.simulated import actor_among, body

FAR = pose((0.0, 3.0, 0.8))
SHOE = replace(body("shoe", "shoe", 0.0, 0.0), pose=yawed((0.242, -0.083, TABLE_TOP), -2.17))
BLOCK = body("block", "block", 0.16, 0.04)
TOE_LEFT = [[yawed((-0.117, -0.087, TABLE_TOP + 0.004), np.pi)]]
"""On the other half of the table, toe to the left: no grasp of the shoe as it stands leads
there."""


@pytest.fixture
def actor() -> Actor:
    return actor_among(SHOE, BLOCK)


def test_nothing_is_set_down_where_one_grasp_does(actor: Actor) -> None:
    assert not list(regrasp(actor, "right", "shoe", [[actor.pose("shoe")]]))


def test_nothing_is_set_down_where_it_would_not_help(actor: Actor) -> None:
    assert len(find_seats(actor, "right", "shoe", [[FAR]])) == 0
    assert not list(regrasp(actor, "right", "shoe", [[FAR]]))


def test_from_a_seat_a_grasp_leads_to_the_goal(actor: Actor) -> None:
    goals = TOE_LEFT
    assert not promising(actor, actor.arm_planner("right"), "shoe", actor.pose("shoe"), goals)
    seats = find_seats(actor, "right", "shoe", goals)
    assert 0 < len(seats) <= SEAT.wanted
    reach = np.linalg.norm(SHOE.instance.shape().aabb()[:, :2], axis=1).min()
    for seat in seats:
        assert seat[2] == TABLE_TOP and seat[0] >= 0
        assert np.linalg.norm(seat[:2] - BLOCK.pose[:2]) > min(reach, 0.03), (
            "the seat is on the block"
        )
    for skill in regrasp(actor, "right", "shoe", goals):
        actor.perform(skill)
    assert "right" not in actor.held and actor.gripper("right") == 1.0
    assert np.linalg.norm(actor.pose("shoe")[:3] - seats[:, :3], axis=1).min() < 0.02
    assert promising(actor, actor.arm_planner("right"), "shoe", actor.pose("shoe"), goals)


def test_the_first_skill_that_can_be_planned_is_taken(actor: Actor) -> None:
    actor.perform(first_of(move("right", FAR), lift("right", 0.02)))
    assert actor.simulation.steps > 0
    with pytest.raises(PlanFailure, match="unreachable"):
        actor.perform(first_of(move("right", FAR), move("right", FAR)))
    # what could not be planned is not noted
    assert actor.skills == [SkillRun("lift", ("right",), "", "", "meet", 0, actor.simulation.steps)]


def test_skills_in_turn_are_planned_one_after_the_other(actor: Actor) -> None:
    actor.perform(in_turn(grasp("right", "block"), lift("right", 0.05)))
    assert actor.held == {"right": "block"} and actor.pose("block")[2] > TABLE_TOP + 0.03
    actor.perform(in_turn(open_("right")))
    assert not actor.held
    taking, lifting, opening = actor.skills
    assert [run.skill for run in actor.skills] == ["grasp", "lift", "open"]
    assert {run.body for run in actor.skills} == {"block"}
    assert (
        0
        == taking.start
        < taking.end
        == lifting.start
        < lifting.end
        == opening.start
        < opening.end
        == actor.simulation.steps
    )


def test_jaws_come_in_less_wide_where_they_do_not_fit() -> None:
    """Fully open, the inner finger does not fit into a bowl 10 cm wide."""
    bowl = Bowl(radius=0.0525, height=0.037, foot=0.029, belly=0.109, colour="mint", inside="mint")
    actor = actor_among(replace(body("bowl", "bowl", 0.256, 0.035), instance=bowl))
    widths = []
    for step in grasp("right", "bowl")(actor):
        actor.execute(step)
        widths.append(actor.gripper("right"))
    assert min(widths[:-1]) == widths[-2] < 1.0 and widths[-1] == 0.0
    assert actor.held == {"right": "bowl"}
    actor.perform(lift("right", 0.08))
    assert actor.pose("bowl")[2] > TABLE_TOP + 0.04

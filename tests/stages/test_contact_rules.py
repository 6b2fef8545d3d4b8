"""What the first touch does and who may make it: the rules of tracking tasks, in physics."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.recipe.model import Recipe
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.expert.budgets import TIMING
from pipeline.expert.skills import close, lift, open_, press
from pipeline.motion.planar import PlanarMotion, Segment
from pipeline.planning.failure import PlanFailure
from pipeline.stages.attempt import attempt
from pipeline.stages.failure import Failure
from pipeline.stages.scene import Scene, build_scene, rest
from pipeline.tasks.outcome import failed

TASK = EpisodeSpec("move_pillbottle_pad", "aloha-agilex", 1, 0.1, "clean", 0, 0)
SPEED, TAP = 0.04, 2.5


def passing(pose):
    """A straight motion towards the robot at SPEED that passes over `pose` at the time of the
    tap."""
    start = np.add(pose[:2], (0, SPEED * TAP))
    return PlanarMotion(
        1,
        0.1,
        3.0,
        0.0,
        float(pose[2]),
        pose[3:],
        (Segment(0.0, 3.0, np.array([start, [0, -SPEED * 3.0]]).T),),
    )


def tapped_and_then_served(scene: Scene):
    """The actor of a policy that stops the pad with a closed gripper and then does what the expert
    does in the still scene."""
    arm = scene.arms["arm"]
    actor = scene.start(passing(scene.bodies["pad"].pose), 15, "test")
    actor.perform(close(arm))
    spot = scene.bodies["pad"].pose.copy()
    spot[2] += 0.0035  # half a millimetre into the pad, which is elsewhere while this is planned
    for number, step in enumerate(press(arm, spot, depth=0.0)(actor)):
        if number == 1:
            actor.wait(
                max(
                    0.0,
                    TAP
                    + TIMING.press
                    - actor.simulation.time
                    - len(next(iter(step.values())).q) / 240,
                )
            )
        actor.execute(step)
    assert actor.simulation.released
    assert actor.simulation.touched_by.startswith(arm)
    actor.perform(lift(arm, 0.08))
    actor.perform(open_(arm))
    for skill in (*scene.task.meet(actor), *scene.task.finish(actor)):
        actor.perform(skill)
    rest(actor, scene.task)
    return actor


@pytest.fixture(scope="module")
def tapped():
    for seed in range(12):
        try:
            scene = build_scene(replace(TASK, seed=seed))
            actor = tapped_and_then_served(scene)
        except (Failure, PlanFailure):
            continue
        if failed(scene.task.success(scene.outcome(actor.recorder.log()), scene.arms)) == ():
            return scene, actor.recorder.log()
    raise AssertionError("no tap led to a bottle on the pad")


def test_a_policy_that_taps_the_target_and_then_acts_as_in_the_still_scene_gains_nothing(tapped):
    scene, log = tapped
    assert failed(scene.conditions(log)) == ("met_by_bottle",)
    assert not scene.succeeded(log)


def test_domino_rules_do_not_ask_who_touched_first(tapped):
    scene, log = tapped
    assert "met_by_bottle" not in replace(scene, rules=Rules("domino")).conditions(log)


def first_accepted(task, recipe):
    for seed in range(12):
        try:
            return attempt(replace(TASK, task=task, seed=seed), recipe)
        except Failure:
            continue
    raise AssertionError(f"no attempt at {task} is accepted")


def test_a_target_that_continues_follows_its_motion_through_the_meeting():
    rollout = first_accepted("move_pillbottle_pad", Recipe(contact="continue"))
    log, motion = rollout.replay.log, rollout.motion
    meeting, release = log.time_of("meeting"), log.time_of("release")
    assert meeting is not None
    assert release is not None
    assert release > meeting + 0.5
    following = log.times <= release
    gap = np.linalg.norm(
        log.pose("pad")[following, :3] - motion.position(log.times[following]), axis=1
    )
    assert gap.max() < 1e-4
    assert rollout.scene.succeeded(log)
    # the bottle went with the pad, not with the place where the gripper let it go
    moved = np.linalg.norm(log.pose("pad")[-1, :2] - motion.position(meeting)[:2])
    assert moved > 0.5 * motion.features().end_speed * (release - meeting)


def test_an_interception_target_stops_whatever_the_rules_say():
    rollout = first_accepted("shake_bottle", Recipe(rules="domino", contact="continue"))
    log = rollout.replay.log
    assert log.time_of("release") == log.time_of("meeting")

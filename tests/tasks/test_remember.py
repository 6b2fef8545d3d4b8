"""The tasks of memory and timing in the suite decide: the planned expert solves them, and what they
ask for fails by its name."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.data.recipe.model import Recipe
from pipeline.data.setup import Setup
from pipeline.data.spec import EpisodeSpec
from pipeline.poses import quat_rotate
from pipeline.stages.attempt import attempt
from pipeline.stages.drawing.render import appearance_of, render
from pipeline.stages.failure import Failure
from pipeline.stages.scene import build_scene
from pipeline.tasks import TASKS
from pipeline.tasks.language.check import check_templates
from pipeline.tasks.language.sentences import instructions
from pipeline.tasks.outcome import failed
from tests.tasks.language.grammar import faults

NAMES = [n for n in TASKS if ".decide.remember." in type(TASKS[n]).__module__]


def spec(name, seed=0, level=3):
    return EpisodeSpec(name, "aloha-agilex", level, 0.1, "clean", 0, seed)


@pytest.mark.parametrize("name", NAMES)
def test_layouts_and_sentences_keep_the_contract(name):
    task, scene = TASKS[name], build_scene(spec(name))
    assert task.suite == "decide" and task.workspace.contains(scene.bodies[task.target].pose)
    wording = scene.wording()
    check_templates(wording.seen, wording.unseen, wording.objects, wording.arms)
    made = instructions(wording, np.random.default_rng(0), 60)
    assert [
        (text, found)
        for texts in made.values()
        for text in texts
        if (found := faults(text, wording))
    ] == []


@pytest.fixture(scope="module")
def accepted():
    @cache
    def solve(name, level=1):
        for seed in range(6):
            try:
                return attempt(spec(name, seed, level), Recipe())
            except Failure:
                continue
        return pytest.fail(f"{name}: none of 6 seeds was accepted")

    return solve


def exchanged(log, a, b):
    """The log of what would have been done to body `b` in place of `a`."""
    i, j = log.bodies.index(a), log.bodies.index(b)
    poses, contacts = log.poses.copy(), log.contacts.copy()
    poses[:, [i, j]] = poses[:, [j, i]]
    swap = np.arange(len(log.bodies))
    swap[[i, j]] = j, i
    pairs = np.sort([swap[contacts["a"]], swap[contacts["b"]]], axis=0)
    contacts["a"], contacts["b"] = pairs
    return replace(log, poses=poses, contacts=contacts)


@pytest.mark.parametrize("name", NAMES)
def test_the_planned_expert_solves_it(name, accepted):
    done = accepted(name)
    log, task = done.replay.log, TASKS[name]
    assert all(done.scene.conditions(log).values())
    assert abs(log.time_of("meeting") - done.meeting) <= 1 / 15
    assert done.motion.model == task.motion


@pytest.mark.parametrize(("name", "target"), [("ball_under_cups", "cup"), ("follow_light", "bell")])
def test_the_wrong_one_of_two_fails_by_name(name, target, accepted):
    done = accepted(name)
    wrong = failed(done.scene.conditions(exchanged(done.replay.log, target, "other")))
    assert "other_untouched" in wrong and {"held", "touched"} & {*wrong}


def test_a_ball_that_crossed_the_line_was_stopped_too_late(accepted):
    done = accepted("block_ball")
    log = done.replay.log
    poses, i = log.poses.copy(), log.bodies.index("ball")
    goal = poses[-1, log.bodies.index("goal_line")]
    way = quat_rotate(goal[3:], np.array([1.0, 0, 0]))
    short = (goal[:3] - done.scene.outcome(log).frame("ball", "middle")[:3]) @ way
    for beyond, conditions in ((-0.002, ()), (0.002, ("before_line",))):
        poses[-8:, i, :3] = log.poses[-8:, i, :3] + (short + beyond) * way
        assert failed(done.scene.conditions(replace(log, poses=poses))) == conditions


def test_what_is_in_the_tunnel_is_hidden_from_the_head_camera(accepted):
    done = accepted("catch_from_tunnel", 2)
    log, motion = done.replay.log, done.motion
    way = [np.cos(motion.heading), np.sin(motion.heading), 0.0]
    along = (motion.pose(log.times) - log.pose("tunnel"))[:, :3] @ way
    radius = done.scene.bodies["product"].instance.shape().footprint_radius()
    inside = np.flatnonzero(np.abs(along) < motion.length / 2 - radius - 0.004)
    before = np.flatnonzero(along < -motion.length / 2 - radius)
    setup = Setup(cameras=("head",), render="raster-fast", segmentation=True)
    frames = [int(before[0]), int(inside[0]), int(inside[-1])]
    [view] = render(appearance_of(done.scene, setup), log, segmentation=True, frames=frames)
    seen = (view.segmentation == log.bodies.index("product") + 1).sum((1, 2))
    assert seen[0] > 20 and not seen[1:].any()
    assert len(inside) >= 4 and inside[-1] / 15 < done.meeting


def test_cups_look_the_same_and_the_ball_begins_midway(accepted):
    done = accepted("ball_under_cups")
    bodies, log = done.scene.bodies, done.replay.log
    assert bodies["cup"].instance == bodies["other"].instance
    apart = [np.linalg.norm(log.pose("ball")[0, :2] - log.pose(n)[0, :2]) for n in ("cup", "other")]
    assert apart[0] == pytest.approx(apart[1], abs=1e-3)
    lifted, ball = log.pose("cup")[-1, :3], log.pose("ball")[-1, :3]
    assert lifted[2] - ball[2] > 0.05  # the ball stays on the table

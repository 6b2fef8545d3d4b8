"""Between two recorded frames: lift and hold at every physics step."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.data.episode.state_log import StateLog
from pipeline.data.setup.rules import STRICT
from pipeline.evaluate.scenes.case import expert_actions
from pipeline.evaluate.scenes.trial import SUCCESS, StepConditions, Trial, with_frame
from pipeline.stages.scene import build_scene
from pipeline.tasks.outcome import Outcome
from tests.evaluate.environment.test_env import case_of


def block_log(heights):
    """A log of one body at these heights (m), frame by frame."""
    n = len(heights)
    poses = np.tile([0.0, 0, 0, 1, 0, 0, 0], (n, 1, 1))
    poses[:, 0, 2] = heights
    empty = np.zeros((n, 0))
    contacts = np.empty(0, dtype=[("frame", "<i4")])
    many = {
        "joints": (),
        "qpos": empty,
        "qvel": empty,
        "vector_names": (),
        "state": empty,
        "action": empty,
    }
    return StateLog(
        times=np.arange(n) / 15,
        bodies=("block",),
        poses=poses,
        **many,
        tcp=empty,
        target_velocity=empty,
        contacts=contacts,
    )


@pytest.mark.parametrize(("peak", "lifted"), [(0.78, True), (0.76, False)])
def test_a_lift_between_two_frames_counts(peak, lifted):
    rise = {
        "conditions": lambda outcome, arms: {"was_lifted": outcome.highest_rise("block") > 0.03}
    }
    task = SimpleNamespace(manipulated="block", target="block", limits={"lift": 0.03}, **rise)
    scene = SimpleNamespace(task=task, bodies={}, embodiment=None, rules=STRICT, arms={})
    scene.by_role = lambda log: (scene, log)
    now = {"z": 0.74}
    simulation = SimpleNamespace(
        pose=lambda name: np.array([0, 0, now["z"], 1, 0, 0, 0]), time=1 / 15
    )
    watch = StepConditions(scene, simulation, SimpleNamespace(log=lambda: block_log([0.74, 0.74])))
    for now["z"] in (0.74, peak, 0.74):
        watch.after_step()
    assert watch.conditions() == {"was_lifted": lifted}


def replayed(broken=()):
    """A replay of the expert, with a condition that fails at the physics steps `broken`."""
    case = case_of("click_bell", 1)
    trial = Trial(build_scene(case.spec), case.target_motion)
    asked, true = [], trial.watch.conditions

    def conditions():
        asked.append(trial.simulation.steps)
        return true() | {"unbroken": trial.simulation.steps not in broken}

    trial.watch.conditions = conditions
    actions = expert_actions(case)
    for n in range(len(actions) + 20):
        trial.advance(actions[min(n, len(actions) - 1)])
    return trial, asked


def test_a_hold_that_breaks_between_two_frames_begins_anew():
    trial, asked = replayed()
    end = trial.simulation.steps
    assert trial.ending == SUCCESS
    assert asked[-32:] == list(range(end - 31, end + 1))
    late, _ = replayed({end - 5})
    assert late.ending == SUCCESS
    assert late.simulation.steps == end + 32


def test_a_frame_between_two_is_what_the_recorder_would_have_written():
    trial, _ = replayed()
    log = trial.log()
    scene = trial.scene
    cut = Outcome(log, scene.bodies, scene.embodiment, scene.task.target).until(len(log) - 1).log
    again = with_frame(cut, trial.simulation)
    for name in ("times", "poses", "qpos", "qvel", "state", "tcp", "target_velocity"):
        np.testing.assert_array_equal(getattr(again, name), getattr(log, name))
    np.testing.assert_array_equal(again.action[-2], log.action[-2])

"""The benchmark that catches a can: exact speeds, and nothing of it left behind in the process."""

import numpy as np

from benchmarks.moving_can import CatchCan, Try, draw_exact_speed, moving_cans, one, table
from pipeline.data.spec import EpisodeSpec
from pipeline.motion.contract import MotionRequest
from pipeline.motion.planar_shapes import DRAW, draw_level_1
from pipeline.motion.workspace import Workspace
from pipeline.stages.scene import build_scene
from pipeline.tasks import TASKS

SPEC = EpisodeSpec("catch_can", "franka-panda", 1, 0.2, "clean", 0, 0)


def test_the_speed_is_exact_and_every_path_ends_where_it_must():
    space = Workspace(-0.35, 0.35, -0.25, 0.25)
    asked = MotionRequest(1, 0.2, 1.7, (0.1, -0.05, 0.75), space)
    paths = draw_exact_speed(np.random.default_rng(0), 50, asked)
    travel = paths.coefficients[:, 0, :, 1]
    np.testing.assert_allclose(np.linalg.norm(travel, axis=1) / paths.durations[:, 0], 0.2)
    ends = paths.coefficients[:, 0, :, 0] + travel
    np.testing.assert_allclose(ends, np.broadcast_to(asked.end[:2], (50, 2)))
    assert not paths.missed.any()
    # all around: every quadrant is drawn
    assert len(np.unique(np.sign(travel), axis=0)) == 4


def test_a_can_is_caught_and_the_task_does_not_outlive_the_benchmark():
    tasks, level_1 = set(TASKS), DRAW[1]
    done = one(SPEC)
    assert (done.robot, done.speed, done.reason) == ("franka-panda", 0.2, "")
    assert 0.5 < done.meeting < 3
    assert set(TASKS) == tasks and DRAW[1] is level_1 is draw_level_1
    with moving_cans():
        assert build_scene(SPEC).bodies["can"].instance.radius == 0.03
    assert CatchCan.name not in TASKS


def test_the_table_counts_failures_and_names_their_reasons():
    missed = Try("piper", 0.1, "replay: missed")
    tries = [
        Try("piper", 0.1, "", 1.5),
        missed,
        Try("piper", 0.2, "", 1.7),
        Try("piper", 0.2, "", 1.6),
    ]
    lines = table(tries).splitlines()
    assert lines[2] == "| piper | 50 | 100 | 1.60 |"
    assert lines[-1] == "| piper | 0.10 | replay: missed | 1 |"

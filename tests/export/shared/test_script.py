"""The script in every frame, against runs of skills that are counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.episode.state_log import SkillRun
from pipeline.export.formats.lerobot.format import data_columns
from pipeline.export.formats.parquet_table import Plan, episode_table
from pipeline.export.shared.episodes import read_facts, reading
from pipeline.export.shared.script import describe_runs, rows_of, script_of
from pipeline.motion.recorded import path_ahead
from tests.synthetic import episode_path, make_episode

NAMES = {"block": "the block", "cup": "the cup"}


@pytest.fixture
def facts(tmp_path):
    with reading(make_episode(episode_path(tmp_path), frames=12)) as file:
        return read_facts(file, tmp_path)


def scripted(facts, *runs):
    return script_of(replace(facts, log=replace(facts.log, skills=list(runs))))


def test_a_frame_belongs_to_the_run_that_executes_its_action(facts):
    # frames stand at steps 0, 16, 32 ...: a run of steps 16 to 47 executes the actions of frames 1
    # and 2
    runs = (
        SkillRun("close", ("right",), "", "", "meet", 0, 16),
        SkillRun("press", ("right",), "target", "button", "meet", 16, 48),
    )
    short = SkillRun("lift", ("right",), "", "", "finish", 49, 60)
    script = scripted(facts, *runs, short)
    assert script.skill[:5] == ["close", "press", "press", "wait", "wait"] and set(
        script.skill[3:]
    ) == {"wait"}
    assert script.stage == ["meet"] * 3 + ["finish"] * 9
    assert script.subtask[0] == "close the gripper of the right arm"
    assert script.subtask[1] == "press the button of the bell with the right arm"
    assert script.changes() == [0, 1, 3]
    log = replace(facts.log, skills=[*runs, short])
    frames = [(row["start_frame"], row["end_frame"]) for row in rows_of(replace(facts, log=log))]
    assert frames == [(0, 1), (1, 3), (4, 4)]


def test_the_outer_run_is_said_and_the_inner_one_named(facts):
    outer = SkillRun("hand_over", ("left", "right"), "target", "", "finish", 0, 160)
    script = scripted(facts, outer, SkillRun("grasp", ("right",), "target", "", "finish", 80, 160))
    assert script.skill[:10] == ["hand_over"] * 5 + ["grasp"] * 5
    assert set(script.subtask[:10]) == {"hand the bell over from the left arm to the right arm"}


@pytest.mark.parametrize(
    ("skills", "sentence"),
    [
        ([("lift", "left", "cup"), ("lift", "right", "cup")], "lift the cup with both arms"),
        (
            [("lift", "left", "cup"), ("home", "right", "")],
            "lift the cup with the left arm and bring the right arm home",
        ),
        (
            [("grasp", "right", "cup"), ("grasp", "left", "block")],
            "grasp the block with the left arm and grasp the cup with the right arm",
        ),
        ([("shift", "left", "")], "move the left arm"),
        ([("shift", "left", "cup")], "carry the cup with the left arm"),
        ([], ""),
    ],
)
def test_sentences(skills, sentence):
    assert (
        describe_runs(
            [SkillRun(skill, (side,), body, "", "meet", 0, 9) for skill, side, body in skills],
            NAMES,
        )
        == sentence
    )


def test_an_episode_without_a_script_has_empty_texts(facts):
    script = scripted(facts)
    assert (
        set(script.subtask) == set(script.skill) == set(script.stage) == {""}
        and script.changes() == []
    )


def test_a_path_ends_where_the_episode_ends():
    positions = np.arange(12.0).reshape(4, 3)
    path = path_ahead(positions, 2)
    assert path.shape == (4, 2, 3)
    assert path[:, :, 0].tolist() == [[3, 6], [6, 9], [9, 9], [9, 9]]


def test_where_a_policy_acts_frames_say_so_and_keep_what_the_expert_would_have_done(tmp_path):
    path = make_episode(episode_path(tmp_path), frames=6, corrected=2, meta={"corrects": "static"})
    names = {
        "head_camera": "cam_high",
        "left_camera": "cam_left_wrist",
        "right_camera": "cam_right_wrist",
    }
    with reading(path) as file:
        facts = read_facts(file, tmp_path)
        plan = Plan(facts, names, {}, {}, (), (), ())
        table = episode_table(0, facts, file, plan, tmp_path)
    lerobot = data_columns(facts, names, 0, 0, {})
    assert (
        lerobot["intervention"].tolist() == table["intervention"].to_pylist() == [0, 0, 1, 1, 1, 1]
    )
    for column in (lerobot["expert_action"], np.array(table["expert_action"].to_pylist())):
        np.testing.assert_allclose(
            column - facts.log.action, 0.5 * (np.arange(6) < 2)[:, None] + np.zeros(14), atol=1e-6
        )
    script = scripted(facts, SkillRun("lift", ("left",), "", "", "finish", 48, 96))
    assert script.skill == ["policy", "policy", "wait", "lift", "lift", "lift"]

"""The whole way: reference policies in trials, the command, stopped and gone on with, serial and on
two workers."""

import json
import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from pipeline.commands.evaluate import describe_conditions
from pipeline.data.setup import Setup
from pipeline.evaluate.bundle import run_recorded
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.policy import PolicyError
from pipeline.evaluate.scenes.case import expert_actions
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.summary import over_tasks
from pipeline.run.evaluation import evaluation_version
from pipeline.run.identity.core import code_version
from tests.evaluate.environment.test_env import case_of
from tests.run.command import PATIENCE, inside, start

WANTED = ("--tasks", "click_bell", "--levels", "1,3", "--embodiment", "aloha", "--quiet")


def episode(policy, level, clock="sim", task="click_bell"):
    return run_episode(EpisodeJob(case_of(task, level), policy_name(policy), parse_clock(clock)))


@pytest.mark.parametrize(
    ("contact", "solved", "task"),
    [(None, True, "shake_bottle"), ("hold", False, "shake_bottle_horizontally")],
)
def test_a_tap_is_worth_an_episode_unless_the_target_must_be_held(contact, solved, task):
    case = case_of(task, 1, setup=Setup(contact=contact))
    row = run_episode(
        EpisodeJob(
            case,
            policy_name("tapper"),
            parse_clock("sim"),
            setup=Setup(contact=contact, cameras=()),
        )
    )
    assert row["meeting"] and row["success"] is solved
    if contact:
        expert = run_episode(
            EpisodeJob(
                case,
                policy_name("replay"),
                parse_clock("sim"),
                setup=Setup(contact=contact, cameras=()),
            )
        )
        assert expert["success"] and expert["hold"] < 0.5


def test_a_row_names_the_events_that_happened_in_their_order():
    setup = Setup(cameras=(), events=("push@0.5", "stop@0.2", "light@60"))
    job = EpisodeJob(case_of("click_bell", 1), policy_name("still"), parse_clock("sim"))
    row = run_episode(replace(job, setup=setup, paired=True))
    assert row["event"] == "stop+push" and row["same_prefix"]
    assert [(event["name"], event["time"]) for event in row["events"]] == [
        ("stop", pytest.approx(0.2)),
        ("push", pytest.approx(0.5)),
    ]
    late = run_episode(replace(job, setup=Setup(cameras=(), events=("stop@60",))))
    assert (late["event"], late["phase"], late["events"]) == ("none", "none", [])


def without_times(row):
    return {key: value for key, value in row.items() if key != "seconds_spent"}


@pytest.mark.parametrize(
    ("policy", "level", "solved"),
    [
        ("replay", 3, True),
        ("static", 0, True),
        ("static", 1, False),
        ("chaser", 2, True),
        ("interceptor", 1, True),
        ("interceptor", 3, False),
        ("interceptor:delay=0.8", 1, False),
        ("interceptor:foresight=1", 3, True),
        ("reactive", 3, True),
        ("blind", 1, False),
        ("random", 1, False),
    ],
)
def test_reference_policies_are_told_apart(policy, level, solved):
    row = episode(policy, level)
    assert row["success"] is solved
    assert row["same_start"]
    assert (row["manipulation_score"] == 100) is solved
    assert json.loads(json.dumps(row)) == row


ANCHORED = """
import numpy as np
class Anchored:
    def reset(self, start): self.actions = np.load({!r})
    def act(self, observation):
        now = round(observation.time * 15)
        return np.concatenate([self.actions, np.repeat(self.actions[-1:], 600, 0)])[now : now + 20]
def make_policy(): return Anchored()
"""


def test_overlap_takes_the_latency_out_of_a_policy_that_plans_ahead(tmp_path):
    case = case_of("click_bell", 1)
    np.save(tmp_path / "actions.npy", expert_actions(case))
    path = tmp_path / "anchored.py"
    path.write_text(ANCHORED.format(str(tmp_path / "actions.npy")))
    rows = {
        clock: run_episode(EpisodeJob(case, policy_name(str(path)), parse_clock(clock)))
        for clock in ("latency:600", "async:600", "async:600:rtc")
    }
    late = {clock: row["meeting"] - case.meeting for clock, row in rows.items()}
    assert (
        late["latency:600"] > 0.3 > 0.1 > abs(late["async:600"])
        and abs(late["async:600:rtc"]) < 0.1
    )
    assert rows["async:600"]["success"] and rows["async:600:rtc"]["success"]
    with pytest.raises(PolicyError, match="async:200 cannot overlap its chunks"):
        episode("replay", 1, "async:200")


def test_the_same_episode_gives_the_same_numbers_and_latency_changes_them():
    clock = "latency:60"
    again = [without_times(episode("reactive:delay=0.1,noise=0.002", 3)) for _ in range(2)]
    assert again[0] == again[1]
    first, second = (without_times(episode("replay", 1, clock)) for _ in range(2))
    assert first == second
    assert first["seconds"] > without_times(episode("replay", 1))["seconds"]


def test_a_late_robot_misses_a_moving_bell():
    row = episode("replay", 1, "latency:40")
    assert not row["success"]
    # 16 + 9.6 physics steps an action
    assert row["seconds"] == pytest.approx(row["asked"] * 26 / 240, abs=0.11)


def test_a_policy_without_cameras_opens_no_renderer(monkeypatch):
    def no_eyes(*arguments):
        raise AssertionError("a renderer was opened")

    monkeypatch.setattr("pipeline.evaluate.episode.Eyes", no_eyes)
    assert episode("random", 1)["periods"] > 0


def test_the_version_of_results_covers_the_code_that_evaluates():
    assert evaluation_version() == evaluation_version() != code_version()


def test_a_reference_policy_that_answers_in_chunks_waits_once_a_chunk():
    single, chunks = (episode(policy, 1) for policy in ("interceptor", "interceptor:chunk=15"))
    assert chunks["asked"] < single["asked"] / 5
    assert {**without_times(single), "policy": "", "asked": 0, "inferences": 0} == {
        **without_times(chunks),
        "policy": "",
        "asked": 0,
        "inferences": 0,
    }
    whole = episode("replay:chunk=1000", 1, "latency:40")
    assert whole["asked"] == 1
    assert whole["seconds"] == pytest.approx(episode("replay", 1)["seconds"] + 0.04, abs=0.21)
    with pytest.raises(PolicyError, match="whole number"):
        make_policy(policy_name("replay:chunk=0.5"))


CHUNKS = """
import numpy as np
class Chunks:
    def reset(self, start):
        assert start.action_names[6] == "left_gripper" and start.fps == 15 and start.instruction
    def act(self, observation):
        assert observation.joints.shape == (14,)
        {}
def make_policy(): return Chunks()
"""


def test_a_policy_from_a_file_may_answer_in_chunks(tmp_path):
    path = tmp_path / "chunks.py"
    path.write_text(CHUNKS.format("return np.repeat(observation.joints[None], 5, 0)"))
    row = episode(str(path), 1)
    assert row["policy"].startswith("chunks.py@")
    assert row["ending"] == "out_of_view"
    assert row["asked"] == -(-row["periods"] // 5)


# --- the command
# ------------------------------------------------------------------------------------------


def command(*arguments, code=0):
    """The command in this process: its standard output, or its standard error where it must fail
    with `code`."""
    left, out, err = inside("evaluate", *arguments)
    assert left == code, err
    return out if code == 0 else err


def rows_of(out):
    """Rows by key, without times."""
    rows = [json.loads(line) for line in (out / "episodes.jsonl").read_text().splitlines()]
    return {row["key"]: without_times(row) for row in rows}


def kill(wanted, out, _):
    """Kill an evaluation in a process of its own after its first episode."""
    process = start("evaluate", *wanted, "--out", out, new_session=True)
    file, deadline = out / "episodes.jsonl", time.monotonic() + PATIENCE
    while not (file.exists() and file.read_bytes().count(b"\n") >= 1) and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def interrupt(wanted, out, patch):
    """Ctrl-C in the second episode of an evaluation."""
    begun = []

    def interrupted(job):
        begun.append(job)
        if len(begun) == 2:
            signal.raise_signal(signal.SIGINT)
        return run_recorded(job)

    patch.setattr("pipeline.evaluate.evaluate.run_recorded", interrupted)
    assert "rerun the same command to resume" in command(*wanted, "--out", out, code=130)
    patch.undo()


@pytest.mark.parametrize(
    ("stop", "executor"),
    [
        (interrupt, ("--executor", "inline")),
        pytest.param(kill, ("--executor", "inline"), marks=pytest.mark.slow),
        pytest.param(kill, ("--executor", "ray", "--workers", "2"), marks=pytest.mark.slow),
    ],
    ids=["interrupted", "killed", "ray"],
)
def test_stopped_and_gone_on_with_gives_what_an_undisturbed_run_gives(
    tmp_path, monkeypatch, stop, executor
):
    serial, whole = tmp_path / "serial", tmp_path / "whole"
    episodes = 1 if stop is interrupt else 2
    wanted = ("--policy", "random", *WANTED, "--episodes", episodes)
    stop((*wanted, "--executor", "inline"), serial, monkeypatch)
    finished = len(rows_of(serial))
    assert 1 <= finished < 2 * episodes
    told = json.loads(command(*wanted, "--executor", "inline", "--out", serial, "--json"))
    assert told["run"] == 2 * episodes - finished
    manifests = ("--manifests", serial / "manifests")
    other = json.loads(command(*wanted, *executor, *manifests, "--out", whole, "--json"))
    assert other["results"] == told["results"]
    assert rows_of(whole) == rows_of(serial)
    again = json.loads(command(*wanted, "--executor", "inline", "--out", serial, "--json"))
    assert again["run"] == 0
    assert again["results"] == told["results"]
    keys = {
        "task",
        "level",
        "alpha",
        "episodes",
        "success_rate",
        "route_completion",
        "manipulation_score",
    }
    assert all(keys <= cell.keys() and cell["episodes"] == episodes for cell in told["results"])
    assert np.mean([cell["success_rate"] for cell in told["results"]]) < 50


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--policy", "pi7"), "pi7"),
        (("--policy", "replay", "--clock", "sundial"), "sundial"),
        (("--policy", "replay", "--clock", "paused,async:100"), "--clock async:100"),
        (("--policy", "replay", "--clock", "paused,sim"), "names a clock twice"),
        (("--policy", "reactive:cue=2"), "cue=2: give 0 or 1"),
        (("--policy", "replay", "--tasks", "fly"), "fly"),
        (("--policy", "replay", "--cameras", "third_eye"), "third_eye"),
    ],
)
def test_bad_input_is_one_line(tmp_path, arguments, said):
    error = command(*arguments, "--quiet", "--out", tmp_path / "out", code=2)
    assert said in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_conditions_try_a_scene_with_every_set_of_its_events():
    setup = Setup(cameras=(), events=("push@0.5", "stop@0.2"))
    job = EpisodeJob(case_of("click_bell", 1), policy_name("interceptor"), parse_clock("sim"))
    rows = [run_episode(replace(job, case=case, setup=setup)) for case in job.case.arms(2)]
    assert [row["condition"] for row in rows] == ["none", "stop", "push", "push+stop"]
    assert [row["event"] for row in rows] == ["none", "stop", "push", "stop+push"]
    assert [row["phase"] for row in rows] == ["none", *["approach"] * 3]
    plain = run_episode(replace(job, setup=Setup(cameras=())))
    same = ("route_completion", "manipulation_score", "periods", "success")
    assert [rows[0][key] for key in same] == [plain[key] for key in same]
    assert len({row["manipulation_score"] for row in rows}) > 1
    means = over_tasks(rows)
    table = describe_conditions(means)[0].splitlines()
    rates = [100.0 * row["success"] for row in rows]
    assert [float(line.split()[-2]) for line in table[1:3]] == [rates[0], rates[2]]
    assert float(table[3].split()[2]) == rates[3] - rates[1] - rates[2] + rates[0]

"""Policies in a process of their own: what they reach, how their process ends, and what is
refused."""

import threading
import time
from multiprocessing import Pipe
from pathlib import Path

import numpy as np
import pytest

from pipeline.data.errors import DominoError
from pipeline.evaluate import asking
from pipeline.evaluate.asking import introduce
from pipeline.evaluate.child import serve
from pipeline.evaluate.episode import EpisodeJob, run_episode, start_of
from pipeline.evaluate.names import in_process, make_policy, policy_name
from pipeline.evaluate.policies.policy import PolicyError
from pipeline.evaluate.scenes.case import BLIND
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.world.robots import get_embodiment
from tests.evaluate.environment.test_env import case_of
from tests.evaluate.serving.servers import START, look

# finds the trial and wins it, replaces the judge and numpy, and changes what it was given
CHEAT = """
import gc, os
import numpy as np
import pipeline.evaluate.scenes.trial as judge
from pipeline.evaluate.policies.contract import Contract

class Cheat:
    contract = Contract(rate=15)
    inferences = -1
    def reset(self, start): print("no part of a result", {k: v for k, v in os.environ.items() if "secret" in v})
    def act(self, observation):
        answer = observation.joints.copy()
        for found in gc.get_objects() if observation.time == 0 else ():
            if isinstance(found, judge.Trial):
                found.ending = "success"
        judge.failed = lambda conditions: []
        judge.visible = lambda *given: True
        np.clip = lambda value, *given: value
        observation.joints[:] = 9
        return answer

def make_policy(): return Cheat()
"""  # noqa: E501

# what an episode does is the first joint of its first observation: NaN, end by a signal, write into
# the connection, or wait while another process that it has started waits, too
FAULTY = """
import os, subprocess, sys, time
import numpy as np
class Faulty:
    def reset(self, start): pass
    def act(self, observation):
        match int(observation.joints[0]):
            case 0: return observation.joints
            case 1: return observation.joints * np.nan
            case 2: os.kill(os.getpid(), 9)
            case 3:
                os.write(int(sys.argv[1]), b"\\0\\0\\0\\x03abc")
                return observation.joints
            case 4:
                open({path!r}, "w").write(str(subprocess.Popen(["sleep", "60"]).pid))
                time.sleep(60)
            case 5:
                os.write(int(sys.argv[1]), b"\\0\\0\\0\\x0c!1008 no way")
                return observation.joints

def make_policy(): return Faulty()
"""


def at(first):
    observation = look(1)
    observation.joints[0] = first
    return observation


class Holds:
    def reset(self, start): ...

    def act(self, observation):
        return observation.joints


@pytest.fixture
def saved(tmp_path):
    """A function that saves a policy and names it; the processes end with the test."""

    def save(text, prints=None):
        path = tmp_path / "policy.py"
        path.write_text(text)
        return policy_name(str(path), prints)

    yield save
    asking._load.cache_clear()


def test_a_cheat_in_its_own_process_changes_nothing_and_sees_no_secret(
    saved, tmp_path, capfd, monkeypatch
):
    for name in ("DOMINO_POLICY_TOKEN", "AWS_SECRET_ACCESS_KEY", "HF_TOKEN", "DATABASE_URL"):
        monkeypatch.setenv(name, "secret")
    log = tmp_path / "new" / "policy.log"
    name = saved(CHEAT, log)
    start = start_of(get_embodiment("aloha-agilex"), BLIND.override({"fps": 30}), "")
    with pytest.raises(
        PolicyError,
        match=(
            r"^policy policy.py@\w+: control rate: the policy has 15 Hz, the evaluation 30 Hz: add"
        ),
    ):
        introduce(name, [start])
    row = run_episode(EpisodeJob(case_of("click_bell", 1), name, parse_clock("sim")))
    honest = run_episode(
        EpisodeJob(case_of("click_bell", 1), in_process(Holds), parse_clock("sim"))
    )
    assert row == honest | {
        "policy": row["policy"],
        "process": "own",
        "seconds_spent": row["seconds_spent"],
    }
    assert (
        row["process"] == "own" and not row["success"] and row["asked"] == row["inferences"] > 100
    )
    assert "no part of a result {}" in log.read_text() and "no part" not in "".join(
        capfd.readouterr()
    )


def test_what_a_process_does_costs_its_episode(saved, tmp_path):
    child = tmp_path / "child"
    policy = make_policy(saved(FAULTY.format(path=str(child))))
    for first, said in (
        (1, "not finite"),
        (3, "no msgpack"),
        (5, "no way"),
        (2, "the policy's process ended by signal 9"),
        (4, r"no answer in 0\.5 s"),
    ):
        policy.seconds = 0.5 if first == 4 else 20.0
        policy.reset(START)
        with pytest.raises(DominoError, match=said):
            policy.act(at(first))
            # what was written into the connection answers this question or the last one
            policy.act(at(0))
    policy.seconds = 20.0
    policy.reset(START)
    assert np.array_equal(policy.act(at(0))[0], at(0).joints)
    process = policy._link
    _is_gone(int(child.read_text()))
    process._connection.close()  # as the kernel does where the evaluator is killed
    _is_gone(process._process.pid)
    policy.close()


def _is_gone(process):
    until = time.monotonic() + 5
    while time.monotonic() < until:
        try:
            state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        except FileNotFoundError:
            return
        if state == "Z":
            return
        time.sleep(0.02)
    raise AssertionError("the process is still there")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("raise KeyError('weights')", "cannot be loaded: KeyError: 'weights'"),
        ("def make_policy(): raise KeyError('weights')", "KeyError: 'weights'"),
        ("def make_policy(size): return 1", "missing 1 required positional argument: 'size'"),
        ("import sys\ndef make_policy(): sys.exit(3)", "the process ended by itself: exit code 3"),
        ("raise SystemExit", "cannot be loaded: the process ended by itself: exit code 0"),
        ("def make_policy(:", "SyntaxError"),
        ("x = 1", "has no function make_policy"),
        ("def make_policy(): return 7", "has no method reset"),
        (
            (
                "import sys\nclass P:\n    setup = property(lambda self: sys.exit(0))\n    reset ="
                " act = None\n    def reset(self, start): pass\n    def act(self, o):"
                " pass\nmake_policy = P"
            ),
            "attribute setup cannot be read: the process ended by itself: exit code 0",
        ),
        (
            (
                "class Sees:\n    def reset(self, start): pass\n    def act(self, o): pass\n    def"
                " see(self, trial, case): pass\nmake_policy = Sees"
            ),
            ("policy.py: is shown the simulation: add --in-process"),
        ),
    ],
)
def test_what_cannot_be_made_is_one_line(text, reason, tmp_path):
    path = tmp_path / "policy.py"
    path.write_text(text)
    ours, theirs = Pipe()
    thread = threading.Thread(target=serve, args=(theirs, str(path)))
    thread.start()
    told = ours.recv_bytes().decode()
    thread.join(5)
    assert (
        not thread.is_alive()
        and told.startswith("!1008 ")
        and reason in told
        and told.isprintable()
    )


@pytest.mark.parametrize(
    ("text", "process"),
    [
        ("random", "evaluator"),
        ("robotwin:robotwin", "own"),
        ("xpolicylab:model.py", "own"),
        ("mine.py", "own"),
    ],
)
def test_code_of_this_machine_gets_a_process(text, process, tmp_path, monkeypatch):
    (tmp_path / "robotwin").mkdir()
    for file in ("robotwin/deploy_policy.py", "model.py", "mine.py"):
        (tmp_path / file).write_text("")
    monkeypatch.chdir(tmp_path)
    name = policy_name(text)
    assert name.process == process
    kind, _, path = text.rpartition(":")
    assert name.text == (text if text == "random" else f"{kind and f'{kind}:'}{tmp_path / path}")

"""Policies in a process of their own: what they reach, how their process ends, and what is refused."""

import threading
from dataclasses import replace
from multiprocessing import Pipe

import pytest

from pipeline.evaluate.asking import load_once
from pipeline.evaluate.child import serve
from pipeline.evaluate.episode import EpisodeJob, run_episode, start_of
from pipeline.evaluate.evaluate import load_policy
from pipeline.evaluate.names import isolate, policy_name
from pipeline.evaluate.policies.policy import PolicyError, PolicyName
from pipeline.evaluate.scenes.case import BLIND
from pipeline.evaluate.scenes.trial import INVALID_ACTION, NO_ANSWER
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.serving.wire import unpack
from pipeline.world.robots import get_embodiment
from tests.evaluate.test_env import case_of

# finds the trial and wins it, replaces the judge and numpy, and changes what it was given
CHEAT = """
import gc
import numpy as np
import pipeline.evaluate.scenes.trial as judge
from pipeline.evaluate.policies.contract import Contract

class Cheat:
    contract = Contract(rate=15)
    inferences = -1
    def reset(self, start): print("no part of a result")
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
"""

# episodes end by NaN, by SIGKILL, and by silence while another process that it has forked waits, too
FAULTY = """
import os, time
import numpy as np
ENDED = {path!r}
class Faulty:
    def __init__(self): self.episode = 0
    def reset(self, start): self.episode += 1
    def act(self, observation):
        if not os.path.exists(ENDED):
            if self.episode == 1:
                return observation.joints * np.nan
            open(ENDED, "w").close()
            os.kill(os.getpid(), 9)
        os.fork()
        time.sleep(60)

def make_policy(): return Faulty()
"""


def episode(name, seconds=20.0):
    return run_episode(EpisodeJob(case_of("click_bell", 1), name, parse_clock("sim"), answer_seconds=seconds))


@pytest.fixture
def saved(tmp_path):
    """A function that saves a policy and names it in a process of its own; the processes end with the test."""

    def save(text):
        path = tmp_path / "policy.py"
        path.write_text(text)
        return isolate(policy_name(str(path)))

    yield save
    load_once.cache_clear()


def test_a_cheat_in_its_own_process_changes_nothing(saved, tmp_path, capfd):
    log = tmp_path / "new" / "policy.log"
    name = replace(saved(CHEAT), prints=log)
    start = start_of(get_embodiment("aloha-agilex"), BLIND.override({"fps": 30}), "")
    with pytest.raises(PolicyError, match=r"^policy policy.py@\w+: control rate: the policy has 15 Hz, the evaluation 30 Hz: add"):
        load_policy((name, (start,)))
    row = episode(name)
    honest = tmp_path / "honest.py"
    honest.write_text(
        "class Holds:\n    def reset(self, start): pass\n    def act(self, o): return o.joints\nmake_policy = Holds\n"
    )
    own = {"policy": row["policy"], "process": "own", "seconds_spent": row["seconds_spent"]}
    assert row == episode(policy_name(str(honest))) | own
    assert not row["success"] and row["asked"] == row["inferences"] > 100
    assert "no part" in log.read_text() and "no part" not in "".join(capfd.readouterr())


def test_a_process_that_ends_is_replaced_for_the_next_episode(saved, tmp_path):
    name = saved(FAULTY.format(path=str(tmp_path / "ended")))
    rows = [episode(name), episode(name)]
    assert [row["ending"] for row in rows] == [INVALID_ACTION, NO_ANSWER]
    assert "not finite" in rows[0]["fault"] and rows[1]["fault"] == "the policy's process ended by signal 9"
    policy = load_once(name)
    row = episode(name, 0.5)
    assert row["ending"] == NO_ANSWER and row["fault"] == "no answer in 0.5 s"
    with pytest.raises(OSError):  # the process and the one it forked are gone
        policy._channel._connection.send_bytes(b"")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("raise KeyError('weights')", "cannot be loaded: KeyError: 'weights'"),
        (
            "class Sees:\n    def reset(self, start): pass\n    def act(self, o): pass\n    def see(self, trial, case): pass\n"
            "make_policy = Sees",
            "policy.py: is shown the simulation and cannot run in a process of its own: add --in-process",
        ),
    ],
)
def test_what_cannot_be_made_is_one_line(text, reason, tmp_path):
    path = tmp_path / "policy.py"
    path.write_text(text)
    ours, theirs = Pipe()
    thread = threading.Thread(target=serve, args=(theirs, PolicyName(str(path), "policy.py")))
    thread.start()
    told = unpack(ours.recv_bytes())
    thread.join()
    assert told["type"] == "error" and reason in told["reason"]


@pytest.mark.parametrize(
    ("name", "process"),
    [
        (PolicyName("a.py", "a"), "own"),
        (PolicyName("lerobot:d", "d"), "own"),
        (PolicyName("tapper:noise=1", "t"), "evaluator"),
        (PolicyName("Held@12-34", "h"), "evaluator"),  # a class of this process
        (PolicyName("ws://h:1", "s", process="server"), "server"),
    ],
)
def test_code_of_this_machine_gets_a_process(name, process):
    assert isolate(name).process == process

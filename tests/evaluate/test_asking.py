"""Policies that misbehave, here and behind a server: each ends its own episode, is counted and shown, and the next is played."""

import os
import socket
import sys
import threading
import time

import numpy as np
import pytest

from pipeline.evaluate.asking import Asked, load_once
from pipeline.evaluate.episode import EpisodeJob, run_episode, start_of
from pipeline.evaluate.evaluate import load_policy
from pipeline.evaluate.lines import line_of
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.policy import NoAnswer, Observation, PolicyError
from pipeline.evaluate.scenes.case import BLIND
from pipeline.evaluate.scenes.trial import INVALID_ACTION, NO_ANSWER
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.summary import summarise
from pipeline.evaluate.serving.socket import Socket
from pipeline.world.robots import get_embodiment
from tests.evaluate.servers import serving
from tests.evaluate.test_env import case_of
from tests.evaluate.test_other_servers import websocket

POLICY = """
import os, sys, time
import numpy as np
class Misbehaves:
    def reset(self, start): self.length = len(start.action_names)
    def act(self, observation):
        {}
def make_policy(): return Misbehaves()
"""

MISBEHAVIOUR = {
    "NaN": ("return np.full(self.length, np.nan)", INVALID_ACTION, "is not finite at index 0"),
    "inf": ("return np.full((4, self.length), -np.inf)", INVALID_ACTION, "is not finite at index 0"),
    "wrong shape": ("return np.zeros(3)", INVALID_ACTION, "shape (3,)"),
    "giant": ("return np.zeros((100_000, self.length), np.float32)", INVALID_ACTION, "shape (100000, 14)"),
    "complex": ("return np.zeros(self.length, complex)", INVALID_ACTION, "type complex128"),
    "texts": ("return ['1.0'] * self.length", INVALID_ACTION, "type <U3"),
    "objects": ("return [None] * self.length", INVALID_ACTION, "type object"),
    "ragged": ("return [[1.0], [1.0, 2.0]]", INVALID_ACTION, "is no array: ValueError"),
    "exception": ("raise KeyError('left\\n\\x1b[2Jarm')", NO_ANSWER, "KeyError: 'left"),
    "exit": ("sys.exit(0)", NO_ANSWER, "the process ended by itself: exit code 0"),
    "hard exit": ("os._exit(0)", NO_ANSWER, "the process ended by itself: exit code 0 (os._exit)"),
    "exec": ("os.execvp('true', ['true'])", NO_ANSWER, "the process ended by itself: os.execv("),
    "silent": ("time.sleep(60)", NO_ANSWER, "no answer in 0.3 s"),
    "nothing": ("return None", INVALID_ACTION, "type object"),
}


def episode(text, seconds=0.3):
    return run_episode(EpisodeJob(case_of("click_bell", 1), policy_name(text), parse_clock("sim"), answer_seconds=seconds))


@pytest.fixture(autouse=True)
def hang_up(monkeypatch):
    """Close the connections that the policies of a test hold."""
    made = []
    monkeypatch.setattr("pipeline.evaluate.asking.make_policy", lambda name: made.append(make_policy(name)) or made[-1])
    load_once.cache_clear()
    yield
    load_once.cache_clear()
    for policy in made:
        getattr(policy, "close", lambda: None)()


@pytest.mark.parametrize("name", MISBEHAVIOUR)
def test_each_misbehaviour_is_a_counted_episode(tmp_path, name):
    line, ending, said = MISBEHAVIOUR[name]
    path = tmp_path / "bad.py"
    path.write_text(POLICY.format(line))
    row = episode(str(path))
    assert (row["ending"], row["failure"], row["success"]) == (ending, ending, False)
    assert said in row["fault"] and row["fault"].isprintable()
    assert row["manipulation_score"] == row["route_completion"] == 0
    (cell,) = summarise([row])
    assert cell["episodes"] == cell["failures"][ending] == 1


def test_faults_after_a_good_start_gain_nothing(tmp_path):
    path = tmp_path / "late.py"
    path.write_text(POLICY.format("return observation.joints if observation.time < 0.5 else np.full(self.length, np.nan)"))
    row = episode(str(path))
    assert row["asked"] == row["periods"] == 8 and row["manipulation_score"] == 0
    assert row["ending"] == INVALID_ACTION


EVERY = [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("counting", "charged"),
    [
        ("self.inferences = self.asked // 3", [1, 1, 1, 2, 2, 2, 3]),
        ("self.inferences = 7", [1] * 7),
        ("self.inferences = -5", EVERY),
        ("self.inferences = np.nan", EVERY),
        ("self.inferences = 'none'", EVERY),
        ("self.inferences = True", EVERY),
        ("self.inferences = 100 - self.asked", EVERY),
        ("pass", EVERY),
    ],
)
def test_latency_is_charged_for_the_inferences_that_a_policy_counts(tmp_path, counting, charged):
    """An episode has one inference at least, however a policy counts; a count that is no number of runs counts nothing."""
    path = tmp_path / "counts.py"
    line = f"{counting}; self.asked = self.asked + 1; return np.zeros(2)"
    path.write_text(POLICY.format(line).replace("class Misbehaves:", "class Misbehaves:\n    asked = 3"))
    asked, counts = Asked(policy_name(str(path))), []
    for _ in charged:
        asked.answer(Observation(np.zeros(2), "press", 0.0), 2)
        counts.append(asked.inferences)
    assert counts == charged and asked.count == 7


def test_a_policy_that_was_interrupted_is_made_again(tmp_path):
    path = tmp_path / "silent.py"
    path.write_text(POLICY.format("time.sleep(60)"))
    before = load_once(policy_name(str(path)))
    began = time.monotonic()
    assert episode(str(path))["ending"] == NO_ANSWER
    assert time.monotonic() - began < 5
    assert load_once(policy_name(str(path))) is not before


def test_all_answers_of_an_episode_have_a_limit_together(tmp_path):
    path = tmp_path / "slow.py"
    path.write_text(POLICY.format("time.sleep(0.12); return observation.joints"))
    row = episode(str(path), seconds=0.2)
    assert row["ending"] == NO_ANSWER and 5 <= row["asked"] <= 16


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def make_policy(): raise KeyError('weights')", "KeyError: 'weights'"),
        ("def make_policy(size): return 1", "missing 1 required positional argument: 'size'"),
        ("import sys\ndef make_policy(): sys.exit(0)", "the process ended by itself: exit code 0"),
        ("import sys\ndef make_policy(): sys.exit(3)", "the process ended by itself: exit code 3"),
        ("raise SystemExit", "cannot be loaded: the process ended by itself: exit code 0"),
        ("def make_policy(:", "SyntaxError"),
        ("x = 1", "has no function make_policy"),
        ("def make_policy(): return 7", "int without a method reset"),
    ],
)
def test_a_policy_that_cannot_be_made_is_one_line(tmp_path, text, said):
    path = tmp_path / "bad.py"
    path.write_text(text)
    with pytest.raises(PolicyError) as error:
        make_policy(policy_name(str(path)))
    assert said in str(error.value) and str(error.value).isprintable()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("contract = Contract(rate=50)", "the policy has 50 Hz, the evaluation 15 Hz"),
        ("fps = 30", "--fps 30"),
        ("setup = property(lambda self: sys.exit(0))", "attribute setup cannot be read: the process ended by itself: exit code 0"),
        (
            "contract = property(lambda self: os._exit(0))",
            "contract cannot be read: the process ended by itself: exit code 0 (os._exit)",
        ),
    ],
)
def test_a_policy_that_cannot_be_tried_is_refused_before_any_scene_is_admitted(tmp_path, line, said):
    path = tmp_path / "other.py"
    text = POLICY.format("pass").replace("class Misbehaves:", f"class Misbehaves:\n    {line}")
    path.write_text(f"from pipeline.evaluate.policies.contract import Contract\n{text}")
    start = start_of(get_embodiment("aloha-agilex"), BLIND, "")
    leave = os._exit
    with pytest.raises(PolicyError, match=r"^policy other\.py@") as error:
        load_policy((policy_name(str(path)), (start,)))
    assert said in str(error.value) and os._exit is leave


def test_an_error_that_cannot_be_printed_is_named():
    class Odd(Exception):
        def __str__(self):
            raise ValueError

    assert line_of(Odd()) == "Odd:"
    assert line_of(ValueError("\x1b[31mred\n" + "x" * 9000)).startswith("ValueError: \\x1b[31mred x")


# --- behind a server --------------------------------------------------------------------------------------------------------


class Far:
    """Answers with what `answer` returns for the number of the question."""

    def __init__(self, answer):
        self._answer, self._asked = answer, 0

    def reset(self, start):
        self.length = len(start.action_names)

    def act(self, observation):
        self._asked += 1
        return self._answer(self._asked)


@pytest.mark.parametrize(
    ("answer", "ending", "said"),
    [
        (lambda n: np.full(14, np.nan), INVALID_ACTION, "the action is not finite"),
        (lambda n: sys.exit(0), NO_ANSWER, "the process ended by itself: exit code 0"),
        (lambda n: {}["x"], NO_ANSWER, "KeyError: 'x'"),
        (lambda n: time.sleep(1.5), NO_ANSWER, "no answer in 0.5 s"),
    ],
)
def test_a_served_policy_that_fails_ends_an_episode_and_no_server(answer, ending, said):
    """The server refuses invalid actions itself; the client that waits for a silent one gets a place again."""
    with serving(lambda: Far(answer)) as port:
        for _ in range(2):
            row = episode(f"ws://127.0.0.1:{port}", seconds=0.5)
            assert row["ending"] == ending, row["fault"]
        assert said in row["fault"] or "busy" in row["fault"]


CHUNK = np.zeros((2, 14))
OPENPI = {
    "NaN": ({"actions": CHUNK * np.nan}, INVALID_ACTION, "not finite"),
    "wrong shape": ({"actions": CHUNK[:, :5]}, INVALID_ACTION, "shape (5,)"),
    "no array": ({"actions": [1.0]}, INVALID_ACTION, "no array actions"),
    "records": ({"actions": np.zeros(3, [("a", "f4")])}, INVALID_ACTION, "only booleans, integers and floats"),
    "error": ("Traceback:\nValueError: \x1b[2Jboom", NO_ANSWER, "the server failed: ValueError: \\x1b[2Jboom"),
}


@pytest.mark.parametrize("name", OPENPI)
def test_other_servers_that_answer_wrongly_end_an_episode(name):
    told, ending, said = OPENPI[name]
    with websocket(lambda m: told, {}) as (port, _):
        for _ in range(2):
            row = episode(f"openpi://127.0.0.1:{port}", seconds=9)
            assert row["ending"] == ending and said in row["fault"]


def test_a_time_that_is_not_finite_is_not_used():
    with websocket(lambda m: {"actions": CHUNK, "server_timing": {"infer_ms": float("nan")}}, {}) as (port, _):
        row = episode(f"openpi://127.0.0.1:{port}", seconds=9)
        assert row["ending"] == "out_of_view" and row["fault"] == ""


def test_a_server_that_hangs_up_costs_the_episode_in_which_it_does():
    calls = []

    def answer(message):
        calls.append(message)
        if len(calls) == 2:
            raise ConnectionResetError
        return {"actions": CHUNK}

    with websocket(answer, {}) as (port, _):
        rows = [episode(f"openpi://127.0.0.1:{port}", seconds=9) for _ in range(2)]
    assert [row["ending"] for row in rows] == [NO_ANSWER, "out_of_view"]
    assert "closed the connection" in rows[0]["fault"]


def test_a_server_that_stops_reading_is_given_up():
    with socket.create_server(("127.0.0.1", 0)) as server:

        def greet():
            client, _ = server.accept()
            from websockets.server import ServerProtocol

            protocol = ServerProtocol()
            protocol.receive_data(client.recv(65536))
            protocol.send_response(protocol.accept(protocol.events_received()[0]))
            client.sendall(b"".join(protocol.data_to_send()))
            held.append(client)

        held = []
        thread = threading.Thread(target=greet)
        thread.start()
        link = Socket(f"ws://127.0.0.1:{server.getsockname()[1]}")
        thread.join()
        began = time.monotonic()
        with pytest.raises(NoAnswer, match=r"has read nothing for 0\.3 s"):
            link.send({"image": np.zeros((2000, 2000, 4), np.uint8)}, 0.3)
        assert time.monotonic() - began < 5
        link.close()
        held[0].close()

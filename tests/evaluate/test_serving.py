"""The policy server and its client: what passes, what is refused in one line, and that the next client is always served."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from pipeline import cli
from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.contract import Contract
from pipeline.evaluate.policies.policy import NoAnswer, Observation, PolicyError
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.serving.server import Place, ServeError
from pipeline.evaluate.serving.session import DominoSession, contract_of
from pipeline.evaluate.serving.wire import WireError, pack, unpack
from tests.evaluate.servers import NAMES, START, Echo, serving
from tests.evaluate.test_env import case_of

SECRET = "0123456789abcdef0123"
HELLO = {
    "type": "hello",
    "version": 1,
    "embodiment": "aloha-agilex",
    "action_names": list(NAMES),
    "rate": 15,
    "image_sizes": {"head_camera": [6, 8]},
    "chunk": 1000,
    "normalization": "policy",
    "setup": {},
}
RESET = {"type": "reset", "instruction": "press", "seed": 3}
ACT = {"type": "act", "time": 0.5, "joints": np.zeros(7), "images": {"head_camera": np.zeros((6, 8, 3), np.uint8)}}
DIALOGUE = (HELLO, RESET, ACT)


def remote(port):
    return make_policy(policy_name(f"ws://127.0.0.1:{port}"))


def look(bright, at=1.0):
    return Observation(np.arange(7.0), "press", at, {"head_camera": np.full((6, 8, 3), bright, np.uint8)})


def works(port):
    """A whole dialogue with a client of our own."""
    policy = remote(port)
    policy.reset(START)
    answer = policy.act(look(3))
    policy.close()
    return np.array_equal(answer, np.repeat(np.arange(7.0)[None] + 3, 2, 0))


def raw(port, **options):
    return connect(f"ws://127.0.0.1:{port}", compression=None, proxy=None, close_timeout=1, **options)


# --- what passes ------------------------------------------------------------------------------------------------------------


def test_a_remote_policy_answers_as_the_local_one():
    local = Echo()
    with serving(lambda: local) as port:
        assert policy_name(f"ws://127.0.0.1:{port}").label == "ws:echo"
        policy = remote(port)
        for start in (START, START):
            policy.reset(start)
            assert np.array_equal(policy.act(look(7)), local.act(look(7)))
        assert policy.inferences is None
        local.inferences = 7
        policy.act(look(7))
        assert policy.inferences == 7
        policy.close()
        assert works(port)
    assert local.starts[0] == START and len(local.starts) == 3


def test_depth_goes_over_the_wire_where_there_is_some():
    class Deep(Echo):
        def act(self, observation):
            return observation.joints + (observation.depth["head_camera"].max() if observation.depth else 0)

    with serving(Deep) as port:
        policy = remote(port)
        policy.reset(START)
        flat = look(0)
        far = replace(flat, depth={"head_camera": np.full((6, 8), 1234, np.uint16)})
        np.testing.assert_array_equal(policy.act(flat)[0], flat.joints)
        np.testing.assert_array_equal(policy.act(far)[0], flat.joints + 1234)
        with pytest.raises(PolicyError, match="depth head_camera is float64"):
            policy.act(replace(flat, depth={"head_camera": np.zeros((6, 8))}))


def test_a_connection_that_idled_too_long_is_opened_again_at_the_next_episode():
    with serving(idle_seconds=0.2) as port:
        policy = remote(port)
        policy.reset(START)
        time.sleep(0.5)
        policy.reset(START)
        assert policy.act(look(1)).shape == (2, 7)
        time.sleep(0.5)
        with pytest.raises(PolicyError, match=r"no whole message in 0\.2 s"):
            policy.act(look(1))
        policy.reset(START)
        policy.close()


def test_a_token_is_wanted_before_anything_else(monkeypatch):
    with serving(token=SECRET) as port:
        with pytest.raises(PolicyError, match="wants a token: set DOMINO_POLICY_TOKEN"):
            policy_name(f"ws://127.0.0.1:{port}")
        for wrong in ("x", SECRET[:-1], SECRET + "0", "ü" * 20):
            headers = {"Authorization": f"Bearer {wrong}"}
            with pytest.raises(InvalidStatus) as error, raw(port, additional_headers=headers):
                pass
            assert error.value.response.status_code == 401
        monkeypatch.setenv("DOMINO_POLICY_TOKEN", SECRET)
        assert works(port)


def test_only_loopback_needs_no_token():
    Place("::1"), Place("localhost")
    with pytest.raises(ServeError, match="DOMINO_POLICY_TOKEN"):
        Place("0.0.0.0")
    with pytest.raises(ServeError, match="at least 16"):
        Place("0.0.0.0", token="short")


def test_health_other_paths_and_browsers():
    with serving() as port:
        for path, status in (("/healthz", 200), ("/admin", 404)):
            client = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
            client.request("GET", path)
            assert client.getresponse().status == status
            client.close()
        with pytest.raises(InvalidStatus) as error, raw(port, origin="http://evil.example"):
            pass
        assert error.value.response.status_code == 403
        assert works(port)


@pytest.mark.parametrize(
    ("contract", "both"),
    [
        (Contract(action_names=("a", "b")), ("2 (a b)", "left_gripper")),
        (Contract(image_sizes={"head_camera": (224, 224)}), ("224x224", "8x6")),
        (Contract(rate=50), ("50 Hz", "15 Hz")),
        (Contract(chunk=2000), ("2000", "1000")),
        (Contract(normalization="evaluator"), ("evaluator", "policy")),
    ],
)
def test_a_mismatch_is_refused_by_both_sides_with_both_values(contract, both):
    with serving(lambda: Echo(contract)) as port:
        with pytest.raises(PolicyError) as error:
            remote(port).reset(START)
        with raw(port) as client:
            assert contract_of(unpack(client.recv())["contract"]) == contract
            client.send(pack(HELLO))
            reason = unpack(client.recv(timeout=5))["reason"]
    for line in (str(error.value), reason):
        assert all(value in line for value in both) and "\n" not in line


def test_another_version_is_refused_by_both_sides(monkeypatch):
    with serving() as port:
        with raw(port) as client:
            client.recv()
            client.send(pack(HELLO | {"version": 2}))
            assert unpack(client.recv(timeout=5))["reason"] == "protocol version: the server speaks 1, the client 2"
        monkeypatch.setattr("pipeline.evaluate.serving.client.VERSION", 3)
        with pytest.raises(PolicyError, match="the server speaks 1, this client 3"):
            remote(port)


def test_more_clients_than_policies_are_told_so():
    with serving() as port, raw(port) as first:
        first.recv()
        with pytest.raises(PolicyError, match="busy: give evaluate --workers 1"):
            policy_name(f"ws://127.0.0.1:{port}")
    made = []
    with serving(lambda: made.append(Echo()) or made[-1], clients=2) as port:
        with raw(port) as first:
            first.recv()
            assert works(port)
        assert works(port)
    assert len(made) == 2


def test_a_policy_that_fails_ends_its_client_only():
    with serving() as port:
        policy = remote(port)
        policy.reset(START)
        with pytest.raises(PolicyError, match=r"KeyError: 'too late") as error:
            policy.act(look(0, at=101))
        assert "\n" not in str(error.value)
        assert works(port)


def test_a_policy_that_ends_the_program_ends_its_client_only():
    class Leaves(Echo):
        def act(self, observation):
            sys.exit(0)

    made = []

    def make():
        made.append(Leaves() if not made else Echo())
        return made[-1] if len(made) != 2 else sys.exit(3)

    with serving(make, clients=2) as port:
        policy = remote(port)
        policy.reset(START)
        with pytest.raises(NoAnswer, match="ended by itself: exit code 0"):
            policy.act(look(0))
        with raw(port) as first:
            first.recv()
            with pytest.raises(PolicyError, match="ended by itself: exit code 3"):
                policy_name(f"ws://127.0.0.1:{port}")
        with raw(port) as first:
            first.recv()
            assert works(port)


def test_what_an_unknown_client_sends_does_not_reach_the_terminal_raw():
    lines = []
    with serving(tell=lines.append) as port, raw(port) as client:
        client.recv()
        client.send(pack({"type": "\x1b]0;owned\x07\x1b[2J\nserving nothing"}))
        client.recv(timeout=5)
    assert len(lines) == 1 and lines[0].isprintable() and "owned" in lines[0]


# --- what is refused ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("said", "messages"),
    [
        ("act before reset", (HELLO, ACT)),
        ("reset before hello", (RESET,)),
        ("unknown", ({"type": "exec"},)),
        ("unknown", ({},)),
        ("not an array of floats (7,)", (HELLO, RESET, ACT | {"joints": np.zeros(8)})),
        ("not an array of floats (7,)", (HELLO, RESET, ACT | {"joints": np.zeros(7, int)})),
        ("not an array of floats (7,)", (HELLO, RESET, ACT | {"joints": [0.0] * 7})),
        ("not finite", (HELLO, RESET, ACT | {"joints": np.full(7, np.nan)})),
        ("time is no", (HELLO, RESET, ACT | {"time": float("nan")})),
        ("not those of hello: head_camera", (HELLO, RESET, ACT | {"images": {}})),
        ("not an array of uint8", (HELLO, RESET, ACT | {"images": {"head_camera": np.zeros((600, 8, 3), np.uint8)}})),
        ("not an array of uint8", (HELLO, RESET, ACT | {"images": {"head_camera": np.zeros((6, 8, 3), np.uint16)}})),
        ("instruction is no text", (HELLO, RESET | {"instruction": b"press"})),
        ("instruction is no text", (HELLO, RESET | {"instruction": "p" * 3000})),
        ("seed is no whole number", (HELLO, RESET | {"seed": True})),
        ("action_names is no list", (HELLO | {"action_names": ["a"] * 500},)),
        ("image_sizes is no map", (HELLO | {"image_sizes": {"head_camera": [10**9, 10**9]}},)),
    ],
)
def test_a_message_out_of_place_is_refused_in_one_line(said, messages):
    session = DominoSession(Echo(), "echo")
    for message in messages[:-1]:
        session.answer(unpack(pack(message)))
    with pytest.raises(WireError) as error:
        session.answer(unpack(pack(messages[-1])))
    assert said in str(error.value) and "\n" not in str(error.value)


HOSTILE = {
    "text": "hello",
    "noise": b"\xc1\xff\x00",
    "pickle": b"\x80\x04\x95\x0b\x00\x00\x00\x00\x00\x00\x00\x8c\x02os\x94.",
    "objects": pack(ACT).replace(b"<f8", b"|O8"),
    "records": pack(ACT).replace(b"<f8", b"|V8"),
    "complex": pack(ACT).replace(b"<f8", b"<c8"),
    "another size": pack(ACT).replace(b"\x91\x07", b"\x91\x7f"),
    "cut off": pack(ACT)[:-9],
    "many": b"\x81\xa1a" + b"\xdc\x10\x00" + (b"\xdc\x10\x00" + b"\x90" * 4096) * 10,
    "no map": b"\x93\x01\x02\x03",
}


def test_hostile_messages_end_their_connection_with_a_reason():
    with serving() as port:
        for name, data in HOSTILE.items():
            with raw(port) as client:
                client.recv()
                for message in DIALOGUE[:2]:
                    client.send(pack(message))
                    client.recv(timeout=5)
                client.send(data)
                told = unpack(client.recv(timeout=5))
                assert told["type"] == "error" and len(told["reason"]) > 10, name
                with pytest.raises(ConnectionClosed) as error:
                    client.recv(timeout=5)
                assert error.value.rcvd.code == 1008 and error.value.rcvd.reason[:20] == told["reason"][:20]
        assert works(port)


def test_a_message_larger_than_allowed_is_not_read():
    with serving(largest=100_000) as port:
        with raw(port) as client:
            client.recv()
            with pytest.raises(ConnectionClosed) as error:
                client.send(bytes(3_000_000))
                client.recv(timeout=5)
            assert error.value.rcvd.code == 1009
        assert works(port)


def test_slow_clients_lose_their_place():
    with serving(open_seconds=2.0) as port:
        slow = socket.create_connection(("127.0.0.1", port))
        slow.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n")
        with raw(port) as silent:
            silent.recv()
            assert unpack(silent.recv(timeout=5))["reason"] == "no whole message in 2 s"
        with raw(port) as client:
            client.recv()
            key = bytes([0x82, 0xFE, 0xFF, 0xFF]) + bytes(4)
            began = time.monotonic()
            client.socket.sendall(key)
            with pytest.raises((ConnectionClosed, OSError)):
                while time.monotonic() - began < 8:
                    client.socket.sendall(b"x")
                    time.sleep(0.05)
                    unpack(client.recv(timeout=0))
            assert time.monotonic() - began < 7
        slow.settimeout(5)
        assert slow.recv(100) == b""
        slow.close()
        assert works(port)


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats() | st.text(max_size=9) | st.binary(max_size=30),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4) | st.binary(max_size=4), inner, max_size=4),
    max_leaves=8,
)


@settings(max_examples=200)
@given(st.integers(0, 2), st.sampled_from(sorted({key for m in DIALOGUE for key in m} | {"data"})), JUNK)
@example(0, "normalization", "\n")
@example(2, "time", 101)
def test_any_field_of_any_message_may_be_anything(step, key, value):
    session = DominoSession(Echo(), "echo")
    try:
        for n, message in enumerate(DIALOGUE):
            session.answer(unpack(pack(message | {key: value} if n == step else message)))
    except (WireError, PolicyError) as error:
        assert "\n" not in str(error)
    except KeyError as error:  # Echo's own, at a time past 100 s: the server's part to turn into a line
        assert "too late" in str(error)


def test_noise_on_the_wire_leaves_the_server_alive():
    @settings(max_examples=25)
    @given(st.lists(st.binary(max_size=60), min_size=1, max_size=3), st.booleans())
    def bombard(port, messages, framed):
        if framed:
            with raw(port) as client:
                client.recv()
                try:
                    for message in messages:
                        client.send(message)
                        client.recv(timeout=5)
                except ConnectionClosed:
                    pass
            return
        with socket.create_connection(("127.0.0.1", port)) as client:
            client.sendall(b"".join(messages))

    with serving() as port:
        bombard(port)
        assert works(port)


# --- the whole way ------------------------------------------------------------------------------------------------------------


def test_an_episode_over_the_network_gives_the_numbers_of_one_in_process(tmp_path):
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    words = [sys.executable, "-c", "from pipeline.cli import main; main()", "serve-policy", "random", "--port", "0", "--json"]
    process = subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        told = "".join(iter(lambda: process.stdout.readline() or "}\n", "}\n"))
        port = json.loads(told + "}")["port"]
        case, clock = case_of("click_bell", 1), parse_clock("sim")
        rows = [run_episode(EpisodeJob(case, policy_name(name), clock)) for name in ("random", f"ws://127.0.0.1:{port}")]
        local, over = ({k: v for k, v in row.items() if k not in ("policy", "process", "seconds_spent")} for row in rows)
        assert local == over
        assert [row["policy"] for row in rows] == ["random", "ws:random"]
    finally:
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=20)
    assert (process.returncode, out, err) == (0, "", "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ws://", "is no address"),
        ("ws://127.0.0.1", "is no address"),
        ("ws://127.0.0.1:99999", "Port out of range"),
        ("ws://u:p@127.0.0.1:80", "is no address"),
        ("ws://127.0.0.1:80?fast=1", "option 'fast' is unknown"),
        ("ws://127.0.0.1:1", "cannot be reached"),
    ],
)
def test_an_address_that_leads_nowhere_is_one_line(text, said):
    with pytest.raises(PolicyError, match=said) as error:
        policy_name(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("replay",), "replay is shown the simulation itself and cannot be served"),
        (("pi7",), "'pi7' is unknown"),
        (("random", "--host", "0.0.0.0"), "set DOMINO_POLICY_TOKEN"),
        (("random", "--protocol", "smtp"), "'smtp' is unknown: choose domino or openpi"),
        (("random", "--embodiment", "golem"), "golem"),
    ],
)
def test_a_server_that_cannot_be_started_is_one_line(words, said, monkeypatch, capsys):
    monkeypatch.delenv("DOMINO_POLICY_TOKEN", raising=False)
    monkeypatch.setattr("sys.argv", ["domino-data", "serve-policy", *words, "--port", "0"])
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    error = capsys.readouterr().err.strip()
    assert stopped.value.code == 2 and said in error and "\n" not in error


def test_a_port_that_is_taken_is_one_line(monkeypatch, capsys):
    with serving() as port:
        monkeypatch.setattr("sys.argv", ["domino-data", "serve-policy", "random", "--port", str(port)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
    error = capsys.readouterr().err.strip()
    assert stopped.value.code == 2 and "in use" in error and "\n" not in error

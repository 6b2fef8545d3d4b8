"""The session of a policy, without a network, and the server: what is refused, and that the next
client is always served."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import msgpack
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
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.serving.messages import BUSY, FAILED, INVALID, REFUSED, pack, unpack
from pipeline.evaluate.serving.server import ServeError, ServerAddress
from pipeline.evaluate.serving.session import EpisodeMessage, Offer, ServerOptions, Session, respond
from pipeline.world.robots import get_embodiment
from tests.evaluate.environment.test_env import case_of
from tests.evaluate.serving.servers import NAMES, START, Echo, look, serving

EPISODE = {
    "prompt": "press",
    "embodiment": "aloha-agilex",
    "action_names": list(NAMES),
    "rate": 15,
    "image_sizes": {"head_camera": [6, 8]},
    "seed": 3,
    "setup": {},
    "lift": 0.0,
}
ACT = {
    "state": np.zeros(7),
    "images": {"head_camera": np.zeros((6, 8, 3), np.uint8)},
    "prompt": "press",
    "time": 0.5,
}
RESET = {"reset": EPISODE}


def works(port):
    """A whole dialogue with a client of our own."""
    policy = make_policy(policy_name(f"ws://127.0.0.1:{port}"))
    policy.reset(START)
    answer = policy.act(look(3))
    policy.close()
    return np.array_equal(answer, np.repeat(np.arange(7.0)[None] + 3, 2, 0))


def raw(port, **options):
    return connect(
        f"ws://127.0.0.1:{port}", compression=None, proxy=None, close_timeout=1, **options
    )


def ended(client):
    """The text and the close code with which a server ends a connection."""
    reason = client.recv(timeout=5)
    with pytest.raises(ConnectionClosed) as error:
        client.recv(timeout=5)
    assert (
        isinstance(reason, str)
        and reason.isprintable()
        and error.value.rcvd.reason[:20] == reason[:20]
    )
    return reason, error.value.rcvd.code


# --- a session
# ------------------------------------------------------------------------------------------


def test_what_a_policy_is_told_and_answers():
    policy = Echo(Contract(rate=15))
    policy.inferences = 4
    session = Session(policy, ServerOptions("echo"))
    metadata = unpack(pack(session.metadata()))
    assert metadata["policy"] == "echo" and Offer.read(metadata["domino"]).contract == Contract(
        rate=15
    )
    assert session.answer(RESET) == {}
    answer = unpack(respond(session, pack(ACT)))
    assert (
        answer["actions"].shape == (2, 7)
        and answer["inferences"] == 4
        and answer["server_timing"]["infer_ms"] >= 0
    )
    (start,) = policy.starts
    assert (start.instruction, start.seed, start.action_names, start.image_sizes) == (
        "press",
        3,
        NAMES,
        {"head_camera": (6, 8)},
    )


def test_a_policy_gets_the_names_of_its_actions_and_the_wire_those_of_the_joints():
    policy = Echo(Contract(representation="ee", rotation="6d"))
    Session(policy, ServerOptions("echo")).answer(RESET)
    (start,) = policy.starts
    assert start.state_names == NAMES == EpisodeMessage.of(start).action_names
    assert start.action_names == policy.contract.actions.names(NAMES) != NAMES


@pytest.mark.parametrize(
    ("said", "messages"),
    [
        ("an observation before reset", (ACT,)),
        ("not floats (7,)", (RESET, ACT | {"state": np.zeros(8)})),
        ("not floats (7,)", (RESET, ACT | {"state": np.zeros(7, int)})),
        ("not an array", (RESET, ACT | {"state": [0.0] * 7})),
        ("not finite", (RESET, ACT | {"state": np.full(7, np.nan)})),
        ("time is no", (RESET, ACT | {"time": float("nan")})),
        ("those of reset are missing", (RESET, ACT | {"images": {}})),
        ("not uint8", (RESET, ACT | {"images": {"head_camera": np.zeros((600, 8, 3), np.uint8)}})),
        ("not uint8", (RESET, ACT | {"images": {"head_camera": np.zeros((6, 8, 3), np.uint16)}})),
        ("not uint16", (RESET, ACT | {"depth": {"head_camera": np.zeros((6, 8))}})),
        ("prompt", ({"reset": EPISODE | {"prompt": b"\xff"}},)),
        ("prompt", ({"reset": EPISODE | {"prompt": "p" * 3000}},)),
        ("seed", ({"reset": EPISODE | {"seed": -1}},)),
        ("action_names", ({"reset": EPISODE | {"action_names": ["a"] * 500}},)),
        ("image_sizes", ({"reset": EPISODE | {"image_sizes": {"head_camera": [1]}}},)),
        ("extra", ({"reset": EPISODE | {"extra": 1}},)),
        (
            "control rate: the policy has 15 Hz, the evaluation 30 Hz",
            ({"reset": EPISODE | {"rate": 30}},),
        ),
        ("prompt is no text", ({},)),
    ],
)
def test_a_message_out_of_place_is_refused_in_one_line(said, messages):
    session = Session(Echo(Contract(rate=15)), ServerOptions("echo"))
    *before, (reason, code) = (respond(session, pack(message)) for message in messages)
    assert all(isinstance(answer, bytes) for answer in before)
    assert said in reason and "\n" not in reason and code == REFUSED


JUNK = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats()
    | st.text(max_size=9)
    | st.binary(max_size=30),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=4) | st.binary(max_size=4), inner, max_size=4)
    ),
    max_leaves=8,
)


@settings(max_examples=100)
@given(
    st.sampled_from(sorted({*EPISODE, *ACT, "data", "reset", "depth", "pointcloud", "committed"})),
    JUNK,
)
@example("time", 101)
@example("images", {"head_camera": {}})
def test_any_field_of_any_message_may_be_anything(key, value):
    session = Session(Echo(), ServerOptions("echo"))
    for message in ({"reset": EPISODE | {key: value}}, RESET, ACT | {key: value}):
        answer = respond(session, pack(message))
        assert isinstance(answer, bytes) or (
            "\n" not in answer[0] and answer[1] in (REFUSED, FAILED)
        )


class Brightness:
    """Joints + the first pixel of every camera + `more`."""

    def __init__(self, more=0.0):
        self.starts, self.times, self.more = [], [], more

    def reset(self, start):
        self.starts.append(start)

    def act(self, observation):
        self.times.append(observation.time)
        return (
            observation.joints
            + sum(float(i[0, 0, 0]) for i in observation.images.values())
            + self.more
        )


def test_clients_of_openpi_say_no_reset_and_yet_begin_episodes():
    made = Brightness(more=0.5)
    session = Session(made, ServerOptions("bright"))
    arms = [get_embodiment("aloha").arms[side].home for side in ("left", "right")]
    home = np.array([*arms[0], 0.3, *arms[1], 0.9], np.float32)
    image = np.zeros((3, 24, 32), np.uint8)

    def ask(at, prompt="press", **more):
        message = {
            "state": at.astype(np.float32),
            "images": {"cam_high": image},
            "prompt": prompt,
        } | more
        return respond(session, pack(message))

    def at(*asked):
        assert isinstance(ask(*asked), bytes)
        return made.times[-1]

    assert [at(home), at(home + 0.5), at(home + 0.2)] == pytest.approx([0, 1 / 15, 2 / 15])
    assert at(home) == 0, "the robot was put back to its home"
    assert at(home + 0.5) > 0
    assert at(home + 0.5, "lift") == 0, "another task"
    assert len(made.starts) == 3 and made.starts[0].cameras == ("head_camera",)
    made.more = 0.0
    at(home + 0.01, "lift")  # answers with its way home
    assert at(home, "lift") > 0, "it went home by itself"
    for wrong, said in (
        ({"state": home[:3]}, "state is float32 (3,)"),
        ({"images": {"cam_high": image.astype(float)}}, "no array (3,H,W)"),
        ({"images": 3}, "no map"),
        ({"images": {}}, "other cameras or sizes"),
    ):
        reason, code = ask(home, **wrong)
        assert said in reason and code == REFUSED


# --- a server
# ------------------------------------------------------------------------------------------


def test_a_client_of_openpi_is_served_in_its_own_words():
    def numpy_out(a):
        return {
            b"__ndarray__": True,
            b"data": a.tobytes(),
            b"dtype": a.dtype.str,
            b"shape": a.shape,
        }

    joints, image = np.arange(14, dtype=np.float32) / 10, np.full((3, 24, 32), 9, np.uint8)
    asked = {
        "state": joints,
        "images": {"cam_high": image, "cam_left_wrist": image},
        "prompt": "press",
    }
    with serving(Brightness, options=ServerOptions("bright")) as port, raw(port) as client:
        assert msgpack.unpackb(client.recv(timeout=5))["policy"] == "bright"
        client.send(msgpack.packb(asked, default=numpy_out))
        told = msgpack.unpackb(client.recv(timeout=5))
        assert told["server_timing"]["infer_ms"] >= 0
        found = np.frombuffer(told["actions"][b"data"], told["actions"][b"dtype"]).reshape(
            told["actions"][b"shape"]
        )
        assert np.allclose(found, joints[None] + 18)
        client.send(msgpack.packb({}))
        assert ended(client)[1] == REFUSED


def test_a_token_is_wanted_before_anything_else(monkeypatch):
    secret = "0123456789abcdef0123"
    with serving(token=secret) as port:
        for headers in (
            {},
            *(
                {"Authorization": f"Bearer {wrong}"}
                for wrong in ("x", secret[:-1], secret + "0", "ü" * 20)
            ),
        ):
            with pytest.raises(InvalidStatus) as error, raw(port, additional_headers=headers):
                pass
            assert error.value.response.status_code == 401
        monkeypatch.setenv("DOMINO_POLICY_TOKEN", secret)
        assert works(port)


def test_only_loopback_needs_no_token():
    ServerAddress("::1"), ServerAddress("localhost")
    with pytest.raises(ServeError, match="DOMINO_POLICY_TOKEN"):
        ServerAddress("0.0.0.0")
    with pytest.raises(ServeError, match="at least 16"):
        ServerAddress("0.0.0.0", token="short")


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


def test_a_policy_that_fails_or_ends_the_program_ends_its_client_only():
    class Fails(Echo):
        def act(self, observation):
            match observation.time:
                case 1:
                    sys.exit(0)
                case 2:
                    return np.full(7, np.nan)
            return super().act(observation)

    lines = []
    with serving(Fails, tell=lines.append) as port:
        for time, said, code in (
            (1.0, "ended by itself: exit code 0", FAILED),
            (2.0, "not finite", INVALID),
            (101.0, "KeyError: 'too late", FAILED),
        ):
            with raw(port) as client:
                client.recv(timeout=5)
                client.send(pack(RESET))
                client.recv(timeout=5)
                client.send(pack(ACT | {"time": time}))
                reason, found = ended(client)
                assert said in reason and found == code
        with raw(port) as client:
            client.recv(timeout=5)
            client.send(pack({"reset": EPISODE | {"\x1b]0;owned\x07\nserving": 1}}))
            assert ended(client)[1] == REFUSED
    assert len(lines) == 4 and "owned" in lines[3] and all(line.isprintable() for line in lines)


def test_more_clients_than_policies_are_told_so():
    with serving() as port, raw(port) as first:
        first.recv(timeout=5)
        with raw(port) as second:
            reason, code = ended(second)
            assert "busy: give evaluate --workers 1" in reason and code == BUSY
    made = []
    with serving(lambda: made.append(Echo()) or made[-1], clients=2) as port:
        with raw(port) as first:
            first.recv(timeout=5)
            assert works(port)
        assert works(port)
    assert len(made) == 2


HOSTILE = {
    "text": "hello",
    "noise": b"\xc1\xff\x00",
    "objects": pack(ACT).replace(b"<f8", b"|O8"),
    "another size": pack(ACT).replace(b"\x91\x07", b"\x91\x7f"),
    "no map": b"\x93\x01\x02\x03",
}


def test_hostile_clients_lose_their_connection_and_the_next_is_served():
    with serving(open_seconds=1.0) as port:
        for data in HOSTILE.values():
            with raw(port) as client:
                client.recv(timeout=5)
                client.send(data)
                assert ended(client)[1] == REFUSED
        with raw(port) as silent:
            silent.recv(timeout=5)
            assert ended(silent) == ("no whole message in 1 s", REFUSED)
        with socket.create_connection(("127.0.0.1", port), timeout=5) as slow:
            slow.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n")
            assert slow.recv(100) == b""
        with raw(port) as client:
            client.recv(timeout=5)
            with pytest.raises(ConnectionClosed) as error:
                client.send(bytes(40_000_000))
                client.recv(timeout=5)
            assert error.value.rcvd.code == 1009
        assert works(port)


# --- the whole way
# ------------------------------------------------------------------------------------------


def test_an_episode_over_the_network_gives_the_numbers_of_one_in_process():
    environment = os.environ | {"PYTHONPATH": str(Path(cli.__file__).parents[1])}
    words = [
        sys.executable,
        "-c",
        "from pipeline.cli import main; main()",
        "serve-policy",
        "random",
        "--port",
        "0",
        "--json",
    ]
    process = subprocess.Popen(
        words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        told = "".join(iter(lambda: process.stdout.readline() or "}\n", "}\n"))
        port = json.loads(told + "}")["port"]
        case, clock = case_of("click_bell", 1), parse_clock("sim")
        rows = [
            run_episode(EpisodeJob(case, policy_name(name), clock))
            for name in ("random", f"ws://127.0.0.1:{port}")
        ]
        local, over = (
            {k: v for k, v in row.items() if k not in ("policy", "process", "seconds_spent")}
            for row in rows
        )
        assert local == over
        assert [row["policy"] for row in rows] == ["random", "ws:random"]
    finally:
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=20)
    assert (process.returncode, out, err) == (0, "", "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("replay",), "replay is shown the simulation itself and cannot be served"),
        (("pi7",), "'pi7' is unknown"),
        (("random", "--host", "0.0.0.0"), "set DOMINO_POLICY_TOKEN"),
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

"""Clients of servers: what they refuse, and that no peer makes one wait longer than it may."""

import socket
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace

import msgpack
import numpy as np
import pytest
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.server import ServerProtocol
from websockets.sync.server import serve

from pipeline.data.errors import DominoError
from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.asking import probe_policy
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.contract import Contract
from pipeline.evaluate.policies.policy import NoAnswer, PolicyError
from pipeline.evaluate.serving.address import parse_address
from pipeline.evaluate.serving.websocket import WebSocket
from tests.evaluate.serving.servers import START, Echo, look, serving
from tests.evaluate.serving.test_bridges import websocket

OFFER = {"version": 2, "contract": {"normalization": "policy"}, "setup": {}}


def remote(port, seconds=5.0):
    policy = make_policy(policy_name(f"ws://127.0.0.1:{port}"))
    policy.seconds = seconds
    return policy


def test_a_remote_policy_answers_as_the_local_one():
    local = Echo(Contract(rate=15))
    with serving(lambda: local) as port:
        assert policy_name(f"ws://127.0.0.1:{port}").label == "ws:echo"
        assert (
            policy_name(f"openpi://127.0.0.1:{port}?label=mine&execute=1").label
            == "openpi:mine,execute=1"
        )
        policy = remote(port)
        assert policy.contract == Contract(rate=15)
        for start in (START, START):
            policy.reset(start)
            assert np.array_equal(policy.act(look(7)), local.act(look(7)))
        assert policy.inferences is None
        local.inferences = 7
        policy.act(look(7))
        assert policy.inferences == 7
        policy.close()
    assert local.starts[0] == START and len(local.starts) == 2


def test_depth_goes_over_the_wire_where_there_is_some():
    class Deep(Echo):
        def act(self, observation):
            return observation.joints + (
                observation.depth["head_camera"].max() if observation.depth else 0
            )

    with serving(Deep) as port:
        policy = remote(port)
        policy.reset(START)
        flat = look(0)
        far = replace(flat, depth={"head_camera": np.full((6, 8), 1234, np.uint16)})
        np.testing.assert_array_equal(policy.act(flat)[0], flat.joints)
        np.testing.assert_array_equal(policy.act(far)[0], flat.joints + 1234)
        policy.close()


def test_a_connection_that_idled_too_long_is_opened_again_at_the_next_episode():
    with serving(idle_seconds=0.2) as port:
        policy = remote(port)
        policy.reset(START)
        time.sleep(0.4)
        policy.reset(START)
        assert policy.act(look(1)).shape == (2, 7)
        time.sleep(0.4)
        with pytest.raises(NoAnswer):
            policy.act(look(1))
        policy.reset(START)
        policy.close()


@pytest.mark.parametrize(
    ("contract", "both"),
    [
        (Contract(action_names=("a", "b")), ("2 (a b)", "left_gripper")),
        (Contract(image_sizes={"head_camera": (224, 224)}), ("224x224", "8x6")),
    ],
)
def test_a_mismatch_is_a_refusal_with_both_values(contract, both):
    with serving(lambda: Echo(contract)) as port:
        policy = remote(port)
        with pytest.raises(PolicyError) as error:
            policy.reset(START)
        policy.close()
    assert not isinstance(error.value, NoAnswer) and all(
        value in str(error.value) for value in both
    )


@pytest.mark.parametrize(
    ("offer", "said"),
    [
        (OFFER | {"version": 1}, "the server speaks 1, this client 2"),
        (OFFER | {"contract": {"normalization": "policy", "rate": "fast"}}, "contract.rate"),
        (OFFER | {"setup": {"fps": 7}}, "fps"),
        (3, "the server speaks None"),
        (
            {"version": 2, "contract": {"normalization": "policy"}, "setup": {"\x1b[2J": 1}},
            "is not a key of a setup",
        ),
    ],
)
def test_a_server_with_another_contract_is_refused_at_once(offer, said):
    with (
        websocket(lambda m: {}, {"policy": "x", "domino": offer}) as (port, _),
        pytest.raises(PolicyError, match=said) as error,
    ):
        policy_name(f"ws://127.0.0.1:{port}")
    assert str(error.value).isprintable()


def test_a_server_that_refuses_later_costs_an_episode_and_not_the_evaluation():
    calls = []

    def answer(message):
        calls.append(message)
        return {"id": message["id"]} if len(calls) == 1 else "no more of these"

    with websocket(answer, {"policy": "x", "domino": OFFER}) as (port, _):
        policy = remote(port)
        policy.reset(START)
        with pytest.raises(NoAnswer, match="no more of these"):
            policy.reset(START)


CHUNK = np.zeros((2, 7))


@pytest.mark.parametrize(
    ("told", "kind", "said"),
    [
        ({"actions": CHUNK * np.nan}, ActionError, "not finite"),
        ({"actions": CHUNK[:, :5]}, ActionError, r"shape \(5,\)"),
        ({"actions": [1.0]}, ActionError, "no array actions, but actions"),
        ({"action": 3}, ActionError, "no array actions, but action"),
        ({"actions": np.zeros(3, [("a", "f4")])}, ActionError, "which is no number's"),
        (
            "Traceback:\nValueError: \x1b[2Jboom",
            NoAnswer,
            r"the server failed: ValueError: \\x1b\[2Jboom",
        ),
        (ConnectionResetError(), NoAnswer, "closed the connection"),
    ],
)
def test_what_a_server_does_wrong_is_one_line(told, kind, said):
    def answer(message):
        if isinstance(told, Exception):
            raise told
        return told

    with websocket(answer, {"model": "pi0"}) as (port, _):
        policy = remote(port)
        for _ in range(2):
            policy.reset(START)
            with pytest.raises(kind, match=said) as error:
                policy.act(look(1))
            assert "\n" not in str(error.value)
        policy.close()


@contextmanager
def rude(after):
    """The port of a peer that completes the handshake of every connection, then does what
    `after(connection, protocol)` does."""
    over = threading.Event()

    def talk(client):
        protocol = ServerProtocol()
        protocol.receive_data(client.recv(65536))
        protocol.send_response(protocol.accept(protocol.events_received()[0]))
        client.sendall(b"".join(protocol.data_to_send()))
        with suppress(OSError):
            after(client, protocol, over)
        over.wait(20)
        client.close()

    def accept():
        while not over.is_set():
            try:
                client, _ = server.accept()
            except OSError:
                return
            threading.Thread(target=talk, args=(client,), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=accept, daemon=True).start()
        try:
            yield server.getsockname()[1]
        finally:
            over.set()
            server.shutdown(socket.SHUT_RDWR)


def say(client, protocol, message):
    protocol.send_binary(msgpack.packb(message))
    client.sendall(b"".join(protocol.data_to_send()))


def ping_and_never_read(client, protocol, over):
    say(client, protocol, {})
    while not over.wait(0.001):
        protocol.send_ping(b"x" * 100)
        client.sendall(b"".join(protocol.data_to_send()))


def never_end_the_answer(client, protocol, over):
    say(client, protocol, {})
    protocol.send_binary(b"\x81", fin=False)
    while not over.wait(0.01):
        protocol.send_continuation(b"\xa1", fin=False)
        client.sendall(b"".join(protocol.data_to_send()))


def fall_silent(client, protocol, over):
    say(client, protocol, {})


@pytest.mark.parametrize("after", [ping_and_never_read, never_end_the_answer, fall_silent])
def test_no_peer_makes_a_client_wait(after):
    large = replace(look(1), images={"head_camera": np.zeros((1000, 1000, 3), np.uint8)})
    with rude(after) as port:
        policy = remote(port, 0.5)
        policy.reset(START)
        began = time.monotonic()
        with pytest.raises(NoAnswer, match=r"no answer in 0\.5 s"):
            policy._size = 2000  # more than the buffers of a connection hold
            policy.act(large)
        policy.close()
        assert time.monotonic() - began < 60


def test_a_greeting_without_end_is_given_up(monkeypatch):
    monkeypatch.setattr("pipeline.evaluate.serving.websocket.GREETING_SECONDS", 0.5)

    def greet(client, protocol, over):
        protocol.send_binary(b"\x81", fin=False)
        while not over.wait(0.05):
            protocol.send_continuation(b"\xa1", fin=False)
            client.sendall(b"".join(protocol.data_to_send()))

    with rude(greet) as port, pytest.raises(DominoError, match=r"no answer in 0\.5 s"):
        policy_name(f"ws://127.0.0.1:{port}")


# --- whose answers these are
# ------------------------------------------------------------------------------------------


def named(port, options=""):
    name = policy_name(f"openpi://127.0.0.1:{port}{options}")
    policy = make_policy(name)
    try:
        return probe_policy(name, policy, START)
    finally:
        policy.close()


def test_two_policies_behind_one_port_have_two_labels():
    told = {"actions": np.ones((2, 7))}
    with websocket(lambda m: told, {"model": "pi0"}) as (port, _):
        first, again = named(port, "?execute=1"), named(port, "?execute=1")
        before = named(port, "?label=step-9")
        told["actions"] = np.zeros((2, 7))
        other, after = named(port, "?execute=1"), named(port, "?label=step-9")
    assert (
        first == again
        and first.label == f"openpi://127.0.0.1:{port},execute=1@{first.probe}" != other.label
    )
    assert before.label == after.label == "openpi:step-9" and before.probe != after.probe


def test_a_policy_that_samples_or_fails_needs_a_label():
    rng = np.random.default_rng(0)
    with websocket(lambda m: {"actions": rng.normal(size=(2, 7))}, {"model": "pi0"}) as (port, _):
        with pytest.raises(PolicyError, match=r"its answers differ: name it with \?label=NAME"):
            named(port)
        assert named(port, "?label=x").label == "openpi:x"
    with (
        websocket(lambda m: "no weights", {}) as (port, _),
        pytest.raises(PolicyError, match="the server failed: no weights"),
    ):
        named(port)
    with pytest.raises(PolicyError, match="label: up to 80"):
        parse_address(f"openpi://127.0.0.1:{port}?label=a/b", options=("label",)).label()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ws://", "is no address"),
        ("ws://127.0.0.1", "is no address"),
        ("ws://127.0.0.1:99999", "Port out of range"),
        ("ws://u:p@127.0.0.1:80", "is no address"),
        ("ws://127.0.0.1:80?fast=1", "option 'fast' is unknown"),
        ("ws://127.0.0.1:1", "cannot be reached"),
        ("ws://a\x1b31mb:1", "is no address"),
    ],
)
def test_an_address_that_leads_nowhere_is_one_line(text, said):
    with pytest.raises(PolicyError, match=said) as error:
        policy_name(text)
    assert str(error.value).isprintable()


def test_a_server_sends_nobody_on_to_another_one():
    asked = list[str]()

    def note(_: object, request: Request) -> Response:
        asked.append(request.path)
        return Response(404, "no", Headers())

    def send_on(_: object, request: Request) -> Response:
        place = f"ws://127.0.0.1:{other.socket.getsockname()[1]}"
        return Response(302, "there", Headers(Location=place))

    with serve(print, "127.0.0.1", 0, process_request=note) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        with serve(print, "127.0.0.1", 0, process_request=send_on) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            with pytest.raises(PolicyError, match="redirect"):
                WebSocket(f"ws://127.0.0.1:{server.socket.getsockname()[1]}")
    assert not asked

"""Clients of openpi, StarVLA and GR00T servers against stand-ins of their published formats."""

import io
import json
import threading
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import cv2
import msgpack
import numpy as np
import pytest
import zmq
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from pipeline.data.actions import Representation
from pipeline.data.errors import DominoError
from pipeline.data.names import SIDES
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.contract import actions_of
from pipeline.evaluate.policies.fit import pad_to_square
from pipeline.evaluate.policies.policy import Observation, PolicyError, Start
from pipeline.evaluate.serving.groot import npy
from pipeline.evaluate.serving.history import flow_image
from pipeline.evaluate.serving.messages import MessageError
from pipeline.evaluate.serving.starvla import read_statistics
from pipeline.export.formats.lerobot.format import modality
from pipeline.world.robots import get_embodiment

NAMES = get_embodiment("aloha").vector_names
CAMERAS = ("head_camera", "left_camera")
START = Start(
    "press the bell", "aloha-agilex", NAMES, 15, CAMERAS, 7, dict.fromkeys(CAMERAS, (24, 32))
)
JOINTS = np.arange(14) / 10
TOOL_PARTS = [f"{side}_{part}" for side in SIDES for part in ("position", "rotation", "gripper")]


def look(value=200):
    return Observation(
        JOINTS,
        "press the bell",
        0.0,
        {name: np.full((24, 32, 3), value, np.uint8) for name in CAMERAS},
    )


# The stand-ins read and write messages by the format's own words, with nothing of ours.


def numpy_out(a):
    return {b"__ndarray__": True, b"data": a.tobytes(), b"dtype": a.dtype.str, b"shape": a.shape}


def numpy_in(value):
    if isinstance(value, dict) and b"__ndarray__" in value:
        return np.ndarray(
            buffer=value[b"data"], dtype=np.dtype(value[b"dtype"]), shape=value[b"shape"]
        )
    if isinstance(value, dict):
        return {k: numpy_in(v) for k, v in value.items()}
    return [numpy_in(v) for v in value] if isinstance(value, list) else value


@contextmanager
def websocket(answer, greeting=None):
    """The port of a server that sends a greeting, then answers every message; what it received, and
    its clients' headers."""
    seen = SimpleNamespace(messages=[], headers=[])

    def handle(socket):
        seen.headers.append(socket.request.headers.get("Authorization"))
        if greeting is not None:
            socket.send(msgpack.packb(greeting, default=numpy_out))
        try:
            for data in socket:
                seen.messages.append(numpy_in(msgpack.unpackb(data)))
                told = answer(seen.messages[-1])
                socket.send(
                    told if isinstance(told, str) else msgpack.packb(told, default=numpy_out)
                )
        except ConnectionClosed:
            return

    with serve(handle, "127.0.0.1", 0, compression=None, close_timeout=0.2) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server.socket.getsockname()[1], seen
        finally:
            server.shutdown()
            thread.join()


CHUNK = np.arange(5 * 14, dtype=np.float32).reshape(5, 14) / 100


def test_openpi_is_asked_in_its_own_words(monkeypatch):
    monkeypatch.setenv("DOMINO_POLICY_TOKEN", "0123456789abcdef")
    answers = {"actions": CHUNK, "server_timing": {"infer_ms": 3.0}, "policy_timing": {}}
    with websocket(lambda m: answers, {"model": "pi0"}) as (port, seen):
        policy = make_policy(policy_name(f"openpi://127.0.0.1:{port}?execute=3"))
        policy.reset(START)
        assert np.array_equal(policy.act(look()), CHUNK[:3])
        policy.close()
    asked = seen.messages[0]
    assert set(asked) == {"state", "images", "prompt"}
    assert asked["prompt"] == "press the bell"
    assert asked["state"].dtype == np.float32 and np.allclose(asked["state"], JOINTS)
    assert set(asked["images"]) == {"cam_high", "cam_left_wrist"}
    image = asked["images"]["cam_high"]
    assert image.shape == (3, 224, 224) and image.dtype == np.uint8
    assert image[:, 112, 112].tolist() == [200] * 3 and image[:, 5, 112].tolist() == [0] * 3
    assert set(seen.headers) == {"Api-Key 0123456789abcdef"}


KEYS = {
    "action_keys": [
        f"action.{part}"
        for part in ("left_joints", "right_joints", "left_gripper", "right_gripper")
    ]
}
"""The order of upstream's AgilexDataConfig, which is not ours."""

THEIRS = [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12, 6, 13]
"""Where the numbers in that order are in the joint vector of aloha."""


def starvla(message):
    assert message["type"] == "predict_action"
    return {
        "status": "ok",
        "ok": True,
        "type": "inference_result",
        "request_id": message["request_id"],
        "data": {"actions": CHUNK[None][..., THEIRS]},
    }


def test_starvla_is_asked_in_its_own_words_and_order():
    greeting = KEYS | {"available_unnorm_keys": ["aloha"], "training_obs_image_size": [16, 20]}
    with websocket(starvla, greeting) as (port, seen):
        policy = make_policy(
            policy_name(f"starvla://127.0.0.1:{port}?unnorm_key=aloha&execute=2&state=true")
        )
        policy.reset(START)
        assert np.array_equal(policy.act(look()), CHUNK[:2])
        assert np.array_equal(policy.act(look()), CHUNK[:2])
        policy.close()
        plain = make_policy(policy_name(f"starvla://127.0.0.1:{port}?size=8"))
        plain.reset(START)
        plain.act(look())
        plain.close()
        with pytest.raises(PolicyError, match="unnorm_key 'piper' is unknown to the server"):
            make_policy(policy_name(f"starvla://127.0.0.1:{port}?unnorm_key=piper")).reset(START)
    first, second, third = seen.messages
    assert (
        set(first) == {"type", "request_id", "payload"}
        and first["request_id"] != second["request_id"]
    )
    assert first["payload"]["unnorm_key"] == "aloha" and first["payload"]["do_sample"] is False
    (example,) = first["payload"]["examples"]
    assert example["lang"] == "press the bell"
    # squashed, not padded: no black rows
    assert [i.shape for i in example["image"]] == [(16, 20, 3)] * 2 and (
        example["image"][0] == 200
    ).all()
    assert np.allclose(example["state"], JOINTS[None][:, THEIRS])
    (example,) = third["payload"]["examples"]
    assert set(example) == {"image", "lang"} and example["image"][0].shape == (8, 8, 3)


def test_starvla_answers_with_tool_poses_in_its_own_order():
    keys = [f"action.{part}" for part in reversed(TOOL_PARTS)]
    widths = (1, 6, 3) * 2
    row = np.repeat(np.arange(6.0), widths).astype(np.float32)

    def answer(message):
        return starvla(message) | {"data": {"actions": np.tile(row, (1, 3, 1))}}

    with websocket(answer, {"action_keys": keys}) as (port, _):
        policy = make_policy(policy_name(f"starvla://127.0.0.1:{port}?actions=ee&rotation=6d"))
        policy.reset(START)
        rows = np.asarray(policy.act(look()))
        policy.close()
        joints = make_policy(policy_name(f"starvla://127.0.0.1:{port}"))
        with pytest.raises(PolicyError, match="action keys"):
            joints.reset(START)
    assert rows[0].tolist() == [5] * 3 + [4] * 6 + [3] + [2] * 3 + [1] * 6 + [0]


def test_starvla_of_before_pr_318_is_denormalised_by_its_statistics(tmp_path):
    low, high = np.linspace(-2, -1, 14), np.linspace(1, 3, 14)
    path = tmp_path / "dataset_statistics.json"
    path.write_text(
        json.dumps({"new_embodiment": {"action": {"min": low.tolist(), "max": high.tolist()}}})
    )
    told = np.random.default_rng(0).uniform(-1.2, 1.2, (1, 4, 14)).astype(np.float32)
    order = ",".join(key.removeprefix("action.") for key in KEYS["action_keys"])

    def old(message):
        return starvla(message) | {"data": {"normalized_actions": told}}

    with websocket(old, {"env": "sim"}) as (port, _):
        url = f"starvla://127.0.0.1:{port}?action_keys={order}"
        policy = make_policy(policy_name(f"{url}&statistics={path}"))
        policy.reset(START)
        answer = policy.act(look())
        theirs = np.clip(told[0], -1, 1)
        wanted = low + (theirs + 1) / 2 * (high - low)
        wanted[:, 12:] = theirs[:, 12:]  # StarVLA leaves its binary grippers as they are
        np.testing.assert_allclose(answer[:, THEIRS], wanted, atol=1e-6)
        policy.close()
        without = make_policy(policy_name(url))
        without.reset(START)
        with pytest.raises(DominoError, match=r"normalized_actions: give \?statistics="):
            without.act(look())
        without.close()
    for text, said in (
        ("{}", "has statistics of"),
        ("3", "no dataset_statistics"),
        ('{"a": {"action": {"min": [0]}}}', "'max'"),
    ):
        path.write_text(text)
        with pytest.raises(PolicyError, match=said):
            read_statistics(path, None, "min_max")


def test_starvla_gets_its_history_by_simulated_time():
    with websocket(starvla, KEYS) as (port, seen):
        policy = make_policy(
            policy_name(
                f"starvla://127.0.0.1:{port}?history=2:3&history_mode=frames&history_size=8&execute=4"
            )
        )
        policy.reset(START)
        # four actions and a stride of three have one period in common; the fourth answer comes 0.4
        # s late
        times = [0, 1, 2, 3, 10, 11, 12, 13, 14]
        rows = [policy.act(replace(look(10 * n), time=t / 15)) for n, t in enumerate(times)]
        assert [len(answer) for answer in rows] == [1] * 9 and policy.inferences == 3
        assert np.array_equal(np.concatenate(rows[:4]), CHUNK[:4])
        policy.close()
    shown = [
        [int(image[0, 0, 0]) for image in m["payload"]["examples"][0]["history_images"]]
        for m in seen.messages
    ]
    # at period 0 nothing is past; at 10, periods 4 and 7 show the image of 3; at 14, 8 shows 3 and
    # 11 itself
    assert shown == [[0, 0], [30, 30], [30, 50]]
    assert seen.messages[0]["payload"]["examples"][0]["history_images"][0].shape == (8, 8, 3)


def test_flow_images_are_black_without_motion_and_red_to_the_right():
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.integers(0, 255, (64, 80, 3), np.uint8), (9, 9), 0)
    before, after = texture[:, 8:72], texture[:, 5:69]
    assert not flow_image(np.full_like(before, 90), np.full_like(before, 90)).any()
    red, green, blue = flow_image(before, after)[16:48, 16:48].reshape(-1, 3).mean(0)
    assert red > 4 * max(green, blue)


@pytest.mark.parametrize(
    ("greeting", "said"),
    [
        ({"env": "sim"}, "does not tell the order of its actions"),
        ({"action_keys": 3}, "does not tell the order"),
        (
            {"action_keys": ["action.base", *KEYS["action_keys"]]},
            "action keys: the server has base left_joints",
        ),
        ({"action_keys": KEYS["action_keys"][:3]}, "action keys"),
    ],
)
def test_keys_that_are_not_the_robots_are_refused(greeting, said):
    with websocket(starvla, greeting) as (port, _):
        policy = make_policy(policy_name(f"starvla://127.0.0.1:{port}"))
        with pytest.raises(PolicyError, match=said):
            policy.reset(START)
        policy.close()
        if "action_keys" not in greeting:
            order = ",".join(key.removeprefix("action.") for key in KEYS["action_keys"])
            given = make_policy(policy_name(f"starvla://127.0.0.1:{port}?action_keys={order}"))
            given.reset(START)
            assert np.array_equal(given.act(look()), CHUNK)
            given.close()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"request_id": "other"}, "answered request other"),
        ({"request_id": np.arange(2)}, "answered request"),
        ({"ok": np.arange(2), "error": "\x1b[2J"}, r"the server failed: \\x1b"),
        ({"ok": False, "status": "error", "error": "no weights"}, "the server failed: no weights"),
        ({"data": {"actions": CHUNK}}, r"no array \(1,T,A\)"),
        ({"data": None}, r"no array \(1,T,A\)"),
    ],
)
def test_what_starvla_does_wrong_is_one_line(change, said):
    with websocket(lambda m: starvla(m) | change, KEYS) as (port, _):
        policy = make_policy(policy_name(f"starvla://127.0.0.1:{port}"))
        policy.reset(START)
        with pytest.raises(DominoError, match=said):
            policy.act(look())
        policy.close()


@pytest.mark.parametrize(
    "greeting",
    [
        {"action_keys": np.arange(3)},
        {"action_keys": ["\x1b[31m"] * 4},
        KEYS | {"available_unnorm_keys": [np.arange(3), {}]},
        KEYS | {"state_keys": 5},
    ],
)
def test_a_hostile_greeting_of_starvla_is_one_line(greeting):
    with websocket(starvla, greeting) as (port, _):
        policy = make_policy(policy_name(f"starvla://127.0.0.1:{port}?state=true&unnorm_key=k"))
        with pytest.raises(PolicyError) as error:
            policy.reset(START)
        assert str(error.value).isprintable()
        policy.close()


@pytest.mark.parametrize("size", [[True, True], np.arange(2), [10**9, 10**9]])
def test_any_size_of_starvla_is_answered(size):
    with websocket(starvla, KEYS | {"training_obs_image_size": size}) as (port, _):
        policy = make_policy(policy_name(f"starvla://127.0.0.1:{port}"))
        policy.reset(START)
        assert np.array_equal(policy.act(look()), CHUNK)
        policy.close()


def npy_out(a):
    file = io.BytesIO()
    np.save(file, a)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def npy_in(value):
    if isinstance(value, dict) and "__ndarray_class__" in value:
        return np.load(io.BytesIO(value["as_npy"]), allow_pickle=False)
    if isinstance(value, dict):
        return {k: npy_in(v) for k, v in value.items()}
    return [npy_in(v) for v in value] if isinstance(value, list) else value


@contextmanager
def zeromq(answer):
    seen, context = [], zmq.Context()
    socket = context.socket(zmq.REP)
    port = socket.bind_to_random_port("tcp://127.0.0.1")

    def run():
        while True:
            message = npy_in(msgpack.unpackb(socket.recv()))
            seen.append(message)
            if message["endpoint"] == "kill":
                return socket.send(b"\xc0")
            socket.send(msgpack.packb(answer(message), default=npy_out))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield port, seen
    finally:
        with context.socket(zmq.REQ) as last:
            last.connect(f"tcp://127.0.0.1:{port}")
            last.send(msgpack.packb({"endpoint": "kill"}))
            last.recv()
        thread.join()
        socket.close()
        context.term()


def groot(message):
    parts = {"left_joints": 6, "left_gripper": 1, "right_joints": 6, "right_gripper": 1}
    at, action = 0, {}
    for part, width in parts.items():
        action[part], at = CHUNK[None, :, at : at + width], at + width
    return {"ping": {"status": "ok"}, "reset": {}, "get_action": [action, {"seconds": 0.1}]}[
        message["endpoint"]
    ]


def test_groot_is_asked_in_its_own_words():
    with zeromq(groot) as (port, seen):
        policy = make_policy(policy_name(f"gr00t://127.0.0.1:{port}?execute=4"))
        policy.reset(START)
        assert np.array_equal(policy.act(look()), CHUNK[:4])
        policy.close()
    assert [m["endpoint"] for m in seen[:3]] == ["ping", "reset", "get_action"]
    observation = seen[2]["data"]["observation"]
    assert observation["video"]["cam_high"].shape == (1, 1, 24, 32, 3)
    assert observation["state"]["right_joints"].tolist() == [[pytest.approx(JOINTS[7:13].tolist())]]
    assert observation["language"] == {
        "annotation.human.action.task_description": [["press the bell"]]
    }


@pytest.mark.parametrize(
    "actions", [Representation(), Representation("ee-relative", "6d"), Representation("ee-delta")]
)
def test_the_parts_for_groot_are_those_of_our_exports(actions):
    for robot in ("aloha", "franka", "ur5"):
        names = get_embodiment(robot).vector_names
        facts = SimpleNamespace(
            log=SimpleNamespace(vector_names=names),
            action_names=actions.names(names),
            representation=actions,
        )
        exported = {
            part: slice(at["start"], at["end"])
            for part, at in modality(facts, {})["action"].items()
        }
        assert actions.slices(names) == exported


def test_groot_answers_with_tool_poses():
    answer = {
        part: np.full((1, 2, width), i, np.float32)
        for i, (part, width) in enumerate(zip(TOOL_PARTS, (3, 3, 1) * 2, strict=True))
    }
    with zeromq(lambda m: [answer, {}] if m["endpoint"] == "get_action" else {}) as (port, seen):
        name = policy_name(f"gr00t://127.0.0.1:{port}?actions=ee&rotation=axis-angle")
        policy = make_policy(name)
        policy.reset(START)
        rows = np.asarray(policy.act(look()))
        policy.close()
    assert rows[0].tolist() == [0, 0, 0, 1, 1, 1, 2, 3, 3, 3, 4, 4, 4, 5]
    assert actions_of(policy) == Representation("ee", "axis-angle")
    asked = next(m for m in seen if m["endpoint"] == "get_action")
    state = asked["data"]["observation"]["state"]
    assert list(state) == ["left_joints", "left_gripper", "right_joints", "right_gripper"]


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"error": "boom\nbang"}, "the server failed: boom bang"),
        ([{"left_joints": CHUNK}, {}], "no left_gripper"),
        ([{"\x1b[31m": 1}, {}], r"no left_joints, but \\x1b"),
        ([{}, {}], "no left_joints"),
        (
            [
                dict.fromkeys(
                    ("left_joints", "left_gripper", "right_joints", "right_gripper"), CHUNK[None]
                ),
                {},
            ],
            "shapes",
        ),
        (7, "int, not a map"),
    ],
)
def test_what_groot_does_wrong_is_one_line(told, said):
    with zeromq(lambda m: told if m["endpoint"] == "get_action" else {}) as (port, _):
        policy = make_policy(policy_name(f"gr00t://127.0.0.1:{port}"))
        policy.reset(START)
        with pytest.raises(DominoError, match=said) as error:
            policy.act(look())
        assert "\n" not in str(error.value)
        policy.close()


def test_npy_files_are_checked_before_they_are_read():
    def saved(a, **options):
        file = io.BytesIO()
        np.save(file, a, **options)
        return file.getvalue()

    for good in (CHUNK, np.asfortranarray(CHUNK), np.zeros((), np.int8)):
        assert np.array_equal(npy(saved(good)), good)
    whole = saved(np.zeros(4))
    for bad in (
        saved(np.array([{}]), allow_pickle=True),
        saved(np.zeros(2, complex)),
        whole[:-1],
        whole[:20],
        b"",
        b"PK" * 50,
    ):
        with pytest.raises(MessageError):
            npy(bad)
    with pytest.raises(MessageError):
        npy(whole.replace(b"(4,), }             ", b"(400000000000,), }"))


def test_images_are_padded_in_the_middle():
    image = np.full((2, 4, 3), 50, np.uint8)
    assert (
        (pad_to_square(image, 8)[2:6] == 50).all()
        and not pad_to_square(image, 8)[:2].any()
        and not pad_to_square(image, 8)[6:].any()
    )
    assert pad_to_square(np.full((480, 640, 3), 9, np.uint8), 224).shape == (224, 224, 3)

"""Messages: what is sent arrives, and whatever else arrives is refused as a MessageError."""

import itertools
import pickle
import tracemalloc

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.evaluate.serving.messages import MessageError, pack, unpack

NUMBERS = st.sampled_from(["?", "u1", "i2", "<i8", ">i4", "f2", "f4", "f8", ">f8"]).map(np.dtype)
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text(max_size=20)
)
ARRAYS = NUMBERS.flatmap(
    lambda d: hnp.arrays(d, hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))
)
VALUES = st.recursive(
    SCALARS | st.binary(max_size=20) | ARRAYS,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)


def same(a, b):
    if isinstance(a, np.ndarray):
        return (
            isinstance(b, np.ndarray)
            and a.dtype == b.dtype
            and a.shape == b.shape
            and a.tobytes() == b.tobytes()
        )
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and a == b


@settings(max_examples=50)
@given(st.dictionaries(st.text(max_size=8), VALUES, max_size=4))
def test_what_is_sent_arrives(message):
    assert same(message, unpack(pack(message)))


def test_the_bytes_are_those_of_openpi():
    raw = msgpack.unpackb(pack({"a": np.array([[1.5, 2.0]]), "n": np.float32(0.5)}))
    assert raw["a"] == {
        b"__ndarray__": True,
        b"data": np.array([1.5, 2.0]).tobytes(),
        b"dtype": "<f8",
        b"shape": [1, 2],
    }
    assert raw["n"] == {b"__npgeneric__": True, b"data": 0.5, b"dtype": "<f4"}
    # openpi sends the shape as a tuple, which msgpack makes a list
    assert unpack(msgpack.packb(raw))["a"].flags.writeable


@settings(max_examples=100)
@given(st.binary(max_size=200))
def test_noise_is_refused_or_is_a_map(data):
    try:
        assert isinstance(unpack(data), dict)
    except MessageError as error:
        assert "\n" not in str(error)


@settings(max_examples=60)
@given(st.data())
def test_a_damaged_message_is_refused_or_is_a_map(data):
    whole = bytearray(
        pack(
            {
                "type": "act",
                "joints": np.zeros(14),
                "images": {"head": np.zeros((4, 4, 3), np.uint8)},
                "n": [1, 2],
            }
        )
    )
    if data.draw(st.booleans()):
        with pytest.raises(MessageError):
            unpack(bytes(whole[: data.draw(st.integers(0, len(whole) - 1))]))
    else:
        for _ in range(data.draw(st.integers(1, 4))):
            whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
        try:
            assert isinstance(unpack(bytes(whole)), dict)
        except MessageError as error:
            assert "\n" not in str(error)


def keyed(**changes):
    parts = {"__ndarray__": True, "data": bytes(16), "dtype": "<f8", "shape": [2]} | changes
    return msgpack.packb({"a": {key.encode(): value for key, value in parts.items()}})


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (keyed(dtype="|O"), "dtype"),
        (keyed(dtype="|V8"), "dtype"),
        (keyed(dtype="<c16"), "dtype"),
        (keyed(dtype="<U4"), "dtype"),
        (keyed(dtype="<M8[s]"), "dtype"),
        (keyed(dtype="<f8,<f8"), "dtype"),
        (keyed(dtype=b"<f8"), "dtype"),
        (keyed(dtype=[["a", "<f8"]]), "dtype"),
        (keyed(shape=[3]), "16 bytes instead of 24"),
        (keyed(shape=[2**62, 2**62]), "instead of"),
        (keyed(shape=[-1, -2]), "shape"),
        (keyed(shape=[-2]), "shape"),
        (keyed(shape=[True, 2]), "shape"),
        (keyed(shape=2), "shape"),
        (keyed(shape=[1] * 9 + [2]), "shape"),
        (keyed(shape=["2"]), "shape"),
        (keyed(data="x" * 16), "not bytes"),
        (msgpack.packb({"a": {b"__ndarray__": True}}), "not bytes"),
        (msgpack.packb({"a": {b"__npgeneric__": True, b"data": 300, b"dtype": "|u1"}}), "no |u1"),
        (msgpack.packb({"a": {b"__npgeneric__": True, b"data": [1], b"dtype": "|u1"}}), "list"),
        (msgpack.packb([1, 2]), "not a map"),
        (msgpack.packb({"t": msgpack.Timestamp(1)}), "no msgpack"),
        (msgpack.packb({"e": msgpack.ExtType(5, b"x")}), "no msgpack"),
        (msgpack.packb({1: 2}), "no msgpack"),
        (pickle.dumps({"a": 1}), "no msgpack"),
        (b"", "no msgpack"),
        (b"\x81\xa1a\x92" * 2000, "no msgpack"),
        (msgpack.packb({"a": 1}) + b"x", "no msgpack"),
        ("hello", "text"),
    ],
    ids=itertools.count(),
)
def test_what_is_no_message_is_refused_in_one_line(data, said):
    with pytest.raises(MessageError) as error:
        unpack(data)
    assert said in str(error.value) and "\n" not in str(error.value) and len(str(error.value)) < 400


@pytest.mark.parametrize(
    "value",
    [
        np.array([object()]),
        np.zeros(2, "V4"),
        np.zeros(2, complex),
        np.array(["a"]),
        object(),
        {1, 2},
    ],
)
def test_what_cannot_be_read_is_not_sent(value):
    with pytest.raises(MessageError):
        pack({"a": value})


def test_what_a_message_claims_to_hold_takes_no_memory():
    claims = (
        b"\x81\xa1a\xdd\xff\xff\xff\xff",
        b"\x81\xa1a" + b"\xdc\x10\x00" * 900,
        b"\x81\xa1a\xc6\xff\xff\xff\xff",
    )
    tracemalloc.start()
    for data in claims:
        with pytest.raises(MessageError):
            unpack(data)
    assert tracemalloc.get_traced_memory()[1] < 64e6
    tracemalloc.stop()

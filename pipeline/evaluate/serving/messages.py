"""Messages of openpi's protocol (docs/policy_server.md). Nothing received runs."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, cast

import msgpack
import numpy as np

from pipeline.data.errors import DominoError
from pipeline.data.parsing import show_value

LARGEST = 32 * 1024 * 1024
"""Bytes of a message; three images of 1024x1024 and their joints need 9.5 MB."""

MOST_ENTRIES = 4096  # of one list or map

REFUSED, FAILED, INVALID, BUSY = 1008, 1011, 1007, 1013
"""WebSocket close codes: refused, no answer, an answer that is no action, all places taken."""


class MessageError(DominoError, ValueError): ...


def pack(message: Mapping[Any, Any]) -> bytes:
    """A message as bytes. Raises MessageError for an array whose entries are not numbers."""
    try:
        return cast(bytes, msgpack.packb(message, default=_encode_array))
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError(str(error)) from error


def unpack(
    data: bytes | str, decode: Callable[[dict[Any, Any]], Any] | None = None
) -> dict[Any, Any]:
    """The message in bytes; `decode` turns maps into arrays. Raises MessageError for anything but
    one whole map within the limits."""
    if isinstance(data, str):
        raise MessageError(f"the message is text, not bytes: {data[:200]!r}")
    limits = {"max_array_len": MOST_ENTRIES, "max_map_len": MOST_ENTRIES, "max_ext_len": 0}
    try:
        message = msgpack.unpackb(data, object_hook=decode or _decode_array, **limits)
    except MessageError:
        raise
    except (ValueError, RecursionError, msgpack.UnpackException) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MessageError(f"the message is no msgpack: {reason}") from error
    if not isinstance(message, dict):
        raise MessageError(f"the message is a {type(message).__name__}, not a map")
    return message


def _encode_array(value: object) -> dict[bytes, Any]:
    if not isinstance(value, np.ndarray | np.generic):
        raise MessageError(f"a {type(value).__name__} cannot be sent")
    kind = _dtype(value.dtype.str).str
    if isinstance(value, np.generic):
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": kind}
    shape = list(value.shape)
    return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": kind, b"shape": shape}


def _decode_array(values: dict[Any, Any]) -> Any:
    data, shape = values.get(b"data"), values.get(b"shape")
    if b"__npgeneric__" in values:
        kind = _dtype(values.get(b"dtype"))
        if not isinstance(data, bool | int | float):
            raise MessageError(f"a number is a {type(data).__name__}")
        try:
            return kind.type(data)
        except (OverflowError, ValueError) as error:
            raise MessageError(f"{data} is no {kind.str}") from error
    if b"__ndarray__" not in values:
        return values
    if not isinstance(data, bytes):
        raise MessageError(f"the data of an array are of type {type(data).__name__}, not bytes")
    kind = _dtype(values.get(b"dtype"))
    good = isinstance(shape, list) and all(type(n) is int and n >= 0 for n in shape)
    if not isinstance(shape, list) or not good or len(shape) > 8:
        raise MessageError(f"an array has the shape {show_value(shape)}")
    if (size := math.prod(shape) * kind.itemsize) != len(data):
        array = f"an array of shape {shape} and dtype {kind.str}"
        raise MessageError(f"{array} has {len(data)} bytes instead of {size}")
    return np.frombuffer(data, kind).reshape(shape).copy()


def _dtype(text: object) -> np.dtype[Any]:
    if not isinstance(text, str) or not re.fullmatch(r"[<>=|]?(b1|[iu][1248]|f[248])", text):
        raise MessageError(f"an array has the dtype {str(text)[:40]!r}, which is no number's")
    return np.dtype(text)

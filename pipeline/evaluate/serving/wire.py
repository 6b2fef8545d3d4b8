"""Messages as msgpack maps with numpy arrays inside; nothing that arrives is executed, nothing large is made before it is checked.

An array is the map {b"__ndarray__": true, b"data": bytes, b"dtype": "<f8", b"shape": [2, 14]}, a number of numpy's
{b"__npgeneric__": true, b"data": 1.5, b"dtype": "<f4"}: the format of openpi. Of the dtypes only booleans, integers and floats
pass: no objects, records or complex numbers, and no strings or times, which msgpack has itself.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, cast

import msgpack
import numpy as np
from numpy.typing import NDArray

from pipeline.data.parsing import show_value

LARGEST = 32 * 1024 * 1024
"""Bytes of a message; three images of 1024x1024 and their joints need 9.5 MB."""

MOST_OBJECTS = 20_000
"""Keys, numbers, texts and containers in a message, the insides of arrays aside."""

MOST_ENTRIES = 4096
"""Entries of one list or map."""

MOST_DIMENSIONS = 8

_DTYPE = re.compile(r"[<>=|]?(b1|[iu][1248]|f[248])")


class WireError(ValueError):
    """Bytes that are no message. One line."""


def pack(message: Mapping[Any, Any]) -> bytes:
    """A message as bytes. Raises WireError for an array that has another kind of entries than numbers."""
    try:
        return cast(bytes, msgpack.packb(message, default=_encode_array))
    except (TypeError, ValueError, OverflowError) as error:
        raise WireError(str(error)) from error


def unpack(data: bytes | str, largest: int = LARGEST, decode: Callable[[dict[Any, Any]], Any] | None = None) -> dict[Any, Any]:
    """The message in bytes. Raises WireError for anything else than one whole map within the limits.

    `decode` takes the place of what turns maps with b"__ndarray__" into arrays; it raises WireError.
    """
    if isinstance(data, str):
        raise WireError(f"the message is text, not bytes: {data[:200]!r}")
    if len(data) > largest:
        raise WireError(f"the message has {len(data)} bytes, more than {largest}")
    hooks = _Hooks(decode or _decode_array)
    limits = {"max_array_len": MOST_ENTRIES, "max_map_len": MOST_ENTRIES, "max_ext_len": 0}
    try:
        message = msgpack.unpackb(data, list_hook=hooks.of_list, object_pairs_hook=hooks.of_map, strict_map_key=True, **limits)
    except WireError:
        raise
    except (ValueError, RecursionError, msgpack.UnpackException) as error:
        raise WireError(f"the message is no msgpack: {' '.join(str(error).split()) or type(error).__name__}") from error
    if not isinstance(message, dict):
        raise WireError(f"the message is a {type(message).__name__}, not a map")
    return message


def array_of(data: object, dtype: object, shape: object) -> NDArray[Any]:
    """A writable array from its parts as they arrived. Raises WireError if they do not belong together."""
    if not isinstance(data, bytes):
        raise WireError(f"the data of an array are of type {type(data).__name__}, not bytes")
    kind = _dtype(dtype)
    if not isinstance(shape, list) or len(shape) > MOST_DIMENSIONS or not all(type(n) is int and n >= 0 for n in shape):
        raise WireError(f"an array has the shape {show_value(shape)}")
    wanted = math.prod(shape) * kind.itemsize
    if wanted != len(data):
        raise WireError(f"an array of shape {shape} and dtype {kind.str} has {len(data)} bytes instead of {wanted}")
    return np.frombuffer(data, kind).reshape(shape).copy()


def _encode_array(value: object) -> dict[bytes, Any]:
    if isinstance(value, np.ndarray):
        _dtype(value.dtype.str)
        return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": list(value.shape)}
    if isinstance(value, np.generic):
        _dtype(value.dtype.str)
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise WireError(f"a {type(value).__name__} cannot be sent")


def _dtype(text: object) -> np.dtype[Any]:
    if not isinstance(text, str) or not _DTYPE.fullmatch(text):
        raise WireError(f"an array has the dtype {str(text)[:40]!r}: only booleans, integers and floats are passed")
    return np.dtype(text)


def _decode_array(values: dict[Any, Any]) -> Any:
    if b"__ndarray__" in values:
        return array_of(values.get(b"data"), values.get(b"dtype"), values.get(b"shape"))
    if b"__npgeneric__" in values:
        kind, number = _dtype(values.get(b"dtype")), values.get(b"data")
        if not isinstance(number, bool | int | float):
            raise WireError(f"a number is a {type(number).__name__}")
        try:
            return kind.type(number)
        except (OverflowError, ValueError) as error:
            raise WireError(f"{number} is no {kind.str}") from error
    return values


class _Hooks:
    """Called for every container that is complete: counts objects and makes arrays."""

    def __init__(self, decode: Callable[[dict[Any, Any]], Any]) -> None:
        self._decode, self._objects = decode, 0

    def of_list(self, values: list[Any]) -> list[Any]:
        self._count(len(values))
        return values

    def of_map(self, pairs: list[tuple[Any, Any]]) -> Any:
        self._count(2 * len(pairs))
        values = dict(pairs)
        if len(values) < len(pairs):
            raise WireError("a map has the same key twice")
        return self._decode(values)

    def _count(self, entries: int) -> None:
        self._objects += 1 + entries
        if self._objects > MOST_OBJECTS:
            raise WireError(f"the message has more than {MOST_OBJECTS} objects")

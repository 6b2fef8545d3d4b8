"""TFRecord files, without TensorFlow (https://www.tensorflow.org/tutorials/load_data/tfrecord)."""

import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.poses import Floats32, Ints

POLYNOMIAL = 0x82F63B78

MASK_DELTA = 0xA282EAD8

type Value = Sequence[bytes] | Floats32 | Ints


def example(features: Mapping[str, Value]) -> bytes:
    """Features in the order of their names."""
    entries = (
        _field(1, name.encode()) + _field(2, _feature(features[name])) for name in sorted(features)
    )
    return _field(1, b"".join(_field(1, entry) for entry in entries))


def _feature(value: Value) -> bytes:
    if not isinstance(value, np.ndarray):
        return _field(1, b"".join(_field(1, part) for part in value))
    if value.dtype == np.float32:
        return _field(2, _field(1, value.astype("<f4").tobytes()))
    return _field(3, _field(1, b"".join(_varint(int(number) & (2**64 - 1)) for number in value)))


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    digits = bytearray()
    while value > 127:
        digits.append(value & 127 | 128)
        value >>= 7
    return bytes([*digits, value])


def write_records(path: Path, messages: Iterable[bytes]) -> list[int]:
    lengths = []
    with path.open("wb") as f:
        for message in messages:
            length = struct.pack("<Q", len(message))
            for part in (length, message):
                f.write(part + struct.pack("<I", masked_crc(part)))
            lengths.append(len(message))
    return lengths


def masked_crc(data: bytes) -> int:
    crc = int(_crc32c(np.frombuffer(data, np.uint8), _TABLE))
    return ((crc >> 15 | crc << 17) + MASK_DELTA) & 0xFFFFFFFF


def _table() -> NDArray[np.uint32]:
    table, one = np.arange(256, dtype=np.uint32), np.uint32(1)
    for _ in range(8):
        table = np.where(table & 1, table >> one ^ np.uint32(POLYNOMIAL), table >> one)
    return table


_TABLE = _table()


@njit(cache=True)
def _crc32c(data: Any, table: Any) -> Any:
    crc = np.uint32(0xFFFFFFFF)
    for byte in data:
        crc = table[(crc ^ byte) & np.uint32(255)] ^ (crc >> np.uint32(8))
    return crc ^ np.uint32(0xFFFFFFFF)

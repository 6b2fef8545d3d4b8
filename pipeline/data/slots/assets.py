"""A store of what images were drawn from: named arrays and attributes, each once, by hash."""

import io
import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.lib.format as npy
from numpy.typing import NDArray

from pipeline.data.atomic import write_atomic
from pipeline.data.errors import DominoError
from pipeline.data.keys import arrays_digest, canonical, digest
from pipeline.data.reading import check_regular
from pipeline.data.store.place import place_of

INFLATION = 4000
"""No array is larger than this many times its file."""

_ATTRIBUTES = "attributes"
_DIGITS = 32
_FIX = "rerun the command that made this dataset to restore it"


class AssetError(DominoError):
    """A stored asset that is missing or is not what its name says: one line with the fix."""


class AssetStore:
    """Assets of a dataset, in files ROOT/<first two digits>/<hash>.npz."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root)

    def path(self, key: str) -> Path:
        """Where an asset is. Raises AssetError for a key that is no hash."""
        if len(key) != _DIGITS or not set(key) <= set("0123456789abcdef"):
            raise AssetError(f"{key!r} is not the hash of an asset")
        return self.root / key[:2] / f"{key}.npz"

    def keys(self) -> set[str]:
        """The hashes of all assets that are there, by the names of their files."""
        found = set[str]()
        for folder in self.root.iterdir() if self.root.is_dir() else ():
            if folder.is_dir():
                with os.scandir(folder) as files:
                    found.update(
                        file.name.removesuffix(".npz")
                        for file in files
                        if file.name.endswith(".npz")
                    )
        if place := place_of(self.root):
            found.update(path.stem for path in place.files(r"assets/bodies/../.*\.npz"))
        return found

    def put(self, arrays: Mapping[str, NDArray[Any]], attributes: Any) -> str:
        """Keep arrays and attributes (JSON data), unless they are there; returns their hash. Raises
        OSError."""
        key = _hash(arrays, attributes)
        path = self.path(key)
        if not path.exists():
            write_atomic(path, _encode(arrays, attributes))
        return key

    def copy(self, key: str, source: "AssetStore") -> None:
        """Take an asset over from another store, unless it is here. Raises AssetError, OSError."""
        path = self.path(key)
        if not path.exists():
            source.get(key)
            write_atomic(path, source.path(key).read_bytes())

    def get(self, key: str) -> tuple[dict[str, NDArray[Any]], Any]:
        """Arrays and attributes of an asset. Raises AssetError if it is missing or damaged."""
        path = self.path(key)
        try:
            check_regular(path)
            arrays = _arrays(path)
            attributes = json.loads(arrays.pop(_ATTRIBUTES).tobytes())
        except FileNotFoundError as error:
            raise AssetError(f"{path}: is missing; {_FIX}") from error
        except (
            OSError,
            ValueError,
            KeyError,
            EOFError,
            MemoryError,
            RuntimeError,
            zipfile.BadZipFile,
            zlib.error,
        ) as error:
            raise AssetError(
                f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}); remove it:"
                f" {_FIX}"
            ) from error
        if _hash(arrays, attributes) != key:
            raise AssetError(f"{path}: its content is not that of its name; remove it: {_FIX}")
        return arrays, attributes


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a file that `put` wrote. Raises ValueError if one claims another size than it
    has, and the errors of zipfile."""
    arrays, most = dict[str, NDArray[Any]](), INFLATION * path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            if info.file_size > most:
                raise ValueError(
                    f"{info.filename} claims {info.file_size} bytes, more than the file can hold"
                )
            data = bytearray(archive.read(info))
            start = (
                npy.MAGIC_LEN
                + 2
                + int.from_bytes(data[npy.MAGIC_LEN : npy.MAGIC_LEN + 2], "little")
            )
            shape, in_columns, dtype = _header(bytes(data[:start]))
            if math.prod(shape) * dtype.itemsize != len(data) - start:
                raise ValueError(
                    f"{info.filename} claims {dtype} {list(shape)[:8]}, which is not its size"
                )
            array = np.ndarray(shape, dtype, data, start, order="F" if in_columns else "C")
            arrays[info.filename.removesuffix(".npy")] = array
    return arrays


@lru_cache(4096)
def _header(data: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, order and type in the header of an array; numpy compiles each header as Python, and
    few differ. Raises ValueError."""
    stream = io.BytesIO(data)
    npy.read_magic(stream)
    shape, in_columns, dtype = npy.read_array_header_1_0(stream)
    if dtype.hasobject:
        raise ValueError("holds Python objects")
    return shape, in_columns, dtype


def _encode(arrays: Mapping[str, NDArray[Any]], attributes: Any) -> bytes:
    data = io.BytesIO()
    text = np.frombuffer(canonical(attributes), np.uint8)
    np.savez_compressed(
        data,
        allow_pickle=False,
        **{_ATTRIBUTES: text},
        **{name: arrays[name] for name in sorted(arrays)},
    )
    return data.getvalue()


def _hash(arrays: Mapping[str, NDArray[Any]], attributes: Any) -> str:
    return digest([arrays_digest(arrays), attributes])

"""A store of what images were drawn from, each once, by hash."""

import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data.atomic import write_atomic
from pipeline.data.errors import DAMAGE, DominoError
from pipeline.data.keys import arrays_digest, canonical, digest
from pipeline.data.reading import check_regular
from pipeline.data.store.place import place_of

_ATTRIBUTES = "attributes"
_DIGITS = 32
_FIX = "rerun the command that made this dataset to restore it"


class AssetError(DominoError):
    """A stored asset that is missing or damaged: one line with the fix."""


@dataclass(frozen=True)
class AssetStore:
    """Assets of a dataset, in files ROOT/<first two digits>/<hash>.npz."""

    root: Path

    def path(self, key: str) -> Path:
        """Where an asset is. Raises AssetError for a key that is no hash."""
        if len(key) != _DIGITS or not set(key) <= set("0123456789abcdef"):
            raise AssetError(f"{key!r} is not the hash of an asset")
        return self.root / key[:2] / f"{key}.npz"

    def keys(self) -> set[str]:
        """The hashes of all assets that are there, by the names of their files."""
        found = {path.stem for path in self.root.glob("*/*.npz")}
        if place := place_of(self.root):
            found.update(path.stem for path in place.files(r"assets/bodies/../.*\.npz"))
        return found

    def put(self, arrays: Mapping[str, NDArray[Any]], attributes: Any) -> str:
        """Keep arrays and JSON attributes once; returns their hash. Raises OSError."""
        key = _hash(arrays, attributes)
        path = self.path(key)
        if not path.exists():
            data, text = io.BytesIO(), np.frombuffer(canonical(attributes), np.uint8)
            ordered = {name: arrays[name] for name in sorted(arrays)}
            np.savez_compressed(data, allow_pickle=False, **{_ATTRIBUTES: text}, **ordered)
            write_atomic(path, data.getvalue())
        return key

    def copy(self, key: str, source: "AssetStore") -> None:
        """Copy an asset from another store. Raises as `get`, and OSError."""
        path = self.path(key)
        if not path.exists():
            source.get(key)
            write_atomic(path, source.path(key).read_bytes())

    def get(self, key: str) -> tuple[dict[str, NDArray[Any]], Any]:
        """Arrays and attributes. Raises AssetError if they are missing or damaged."""
        path = self.path(key)
        try:
            check_regular(path)
            with np.load(path, allow_pickle=False) as file:
                arrays = dict(file)
            attributes = json.loads(arrays.pop(_ATTRIBUTES).tobytes())
        except FileNotFoundError as error:
            raise AssetError(f"{path}: is missing; {_FIX}") from error
        except (*DAMAGE, zipfile.BadZipFile, zlib.error) as error:
            what = getattr(error, "strerror", None) or error
            raise AssetError(f"{path}: cannot be read ({what}); remove it: {_FIX}") from error
        if _hash(arrays, attributes) != key:
            raise AssetError(f"{path}: its content is not that of its name; remove it: {_FIX}")
        return arrays, attributes


def _hash(arrays: Mapping[str, NDArray[Any]], attributes: Any) -> str:
    return digest([arrays_digest(arrays), attributes])

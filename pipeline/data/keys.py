"""Keys: what made an artifact, as named hashes."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from .reading import open_regular


def canonical(value: Any) -> bytes:
    """JSON with sorted keys, no spaces, UTF-8. Raises ValueError for NaN, TypeError."""
    return json.dumps(
        value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    ).encode()


def digest(value: Any) -> str:
    """sha256 (32 hex digits) of plain data as canonical JSON."""
    return hashlib.sha256(canonical(value)).hexdigest()[:32]


def frames_digest(encoded: Iterable[bytes]) -> str:
    """sha256 of encoded frames: each one's length, then its bytes."""
    h = hashlib.sha256()
    for data in encoded:
        h.update(len(data).to_bytes(8, "little"))
        h.update(data)
    return h.hexdigest()


def arrays_digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    """sha256 of arrays by name: name, type, shape, bytes (C order, little endian)."""
    h = hashlib.sha256()
    for name in sorted(arrays):
        a = np.ascontiguousarray(arrays[name])
        a = a.astype(a.dtype.newbyteorder("<"), copy=False)
        h.update(canonical([name, a.dtype.str, list(a.shape)]))
        h.update(a.data if a.size else b"")
    return h.hexdigest()


def file_hash(path: Path) -> str:
    """sha256 of a file's bytes. Raises OSError for what is no regular file."""
    with open_regular(path) as f:
        return hashlib.file_digest(f, "sha256").hexdigest()


def is_intact(path: Path, sha256: str) -> bool:
    """Whether a file has bytes of this hash. Raises PermissionError."""
    try:
        return file_hash(path) == sha256
    except PermissionError:
        raise
    except OSError:
        return False


@dataclass(frozen=True)
class Key:
    """The hash of named parts, each a hash."""

    parts: Mapping[str, str]

    @cached_property
    def digest(self) -> str:
        """sha256 (32 hex digits)."""
        return digest(dict(self.parts))

    def changed(self, other: "Key") -> list[str]:
        """Names of the parts that differ from `other`, sorted."""
        return sorted(
            n for n in {*self.parts, *other.parts} if self.parts.get(n) != other.parts.get(n)
        )


@dataclass(frozen=True)
class SlotKeys:
    """What decides a slot's physics, and with it its images and its sentences."""

    physics: Key
    render: Key
    language: Key

    def to_json(self) -> dict[str, dict[str, str]]:
        """Plain data."""
        return {name: dict(key.parts) for name, key in vars(self).items() if isinstance(key, Key)}

    def header(self) -> dict[str, Any]:
        """The attributes of an episode file that state the keys, in a fixed order."""
        parts = {kind: dict(sorted(parts.items())) for kind, parts in self.to_json().items()}
        return {"physics_key": self.physics.digest, "render_key": self.render.digest, "keys": parts}

    @classmethod
    def from_json(cls, values: Mapping[str, Mapping[str, str]]) -> "SlotKeys":
        """Inverse of `to_json`. Raises KeyError."""
        return cls(*(Key(dict(values[name])) for name in ("physics", "render", "language")))


SEAL = "sha256"


def seal(values: Mapping[str, Any]) -> bytes:
    """Indented JSON of values, keys sorted, with their hash under SEAL."""
    plain = {name: value for name, value in values.items() if name != SEAL}
    return json.dumps(plain | {SEAL: digest(plain)}, indent=2, sort_keys=True).encode()


def seal_yaml(text: str) -> bytes:
    """The YAML of a mapping, followed by its hash under SEAL."""
    return f"{text}{SEAL}: {digest(yaml.safe_load(text))}\n".encode()


def is_unchanged(values: Mapping[str, Any]) -> bool:
    """Whether values are those that were sealed."""
    plain = {name: value for name, value in values.items() if name != SEAL}
    return values.get(SEAL) == digest(plain)

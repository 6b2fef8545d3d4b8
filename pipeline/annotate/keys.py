"""Keys: what an annotation was made from and with, as hashes of content. No path, clock or host enters a key.

annotation key = sha256 of the canonical JSON of {stage, version, parameters, models, inputs}. `inputs` holds the content hash
of the frames (or poses, or masks) that were read and the prompts that were asked, so a dataset may be moved or copied and
nothing changes, while one altered frame or parameter changes the key.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class AnnotateError(Exception):
    """Something the user can put right; the message is one line that names the thing and the fix."""


def canonical(value: Any) -> bytes:
    """Canonical JSON of plain data: sorted keys, no spaces, UTF-8. Raises ValueError for NaN, TypeError for what JSON lacks."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()


def digest(value: Any) -> str:
    """sha256 (64 hex digits) of the canonical JSON of plain data."""
    return hashlib.sha256(canonical(value)).hexdigest()


def frames_digest(encoded: Iterable[bytes]) -> str:
    """sha256 of a sequence of encoded frames: each one's length, then its bytes, so that no two sequences run together."""
    h = hashlib.sha256()
    for data in encoded:
        h.update(len(data).to_bytes(8, "little"))
        h.update(data)
    return h.hexdigest()


def arrays_digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    """sha256 of named arrays: per name in sorted order its name, type, shape and bytes (C order, little endian)."""
    h = hashlib.sha256()
    for name in sorted(arrays):
        a = np.ascontiguousarray(arrays[name])
        a = a.astype(a.dtype.newbyteorder("<"), copy=False)
        h.update(canonical([name, a.dtype.str, list(a.shape)]))
        h.update(a.data if a.size else b"")
    return h.hexdigest()


def annotation_key(stage: str, version: int, parameters: Mapping[str, Any], inputs: Mapping[str, Any]) -> str:
    """The full key (64 hex digits) of one stage's result for one episode; `parameters` include the models' digests."""
    return digest({"stage": stage, "version": version, "parameters": dict(parameters), "inputs": dict(inputs)})


def stage_key(stage: str, version: int, parameters: Mapping[str, Any]) -> str:
    """The first 8 hex digits that name a stage's directory: the key without its inputs."""
    return digest({"stage": stage, "version": version, "parameters": dict(parameters)})[:8]

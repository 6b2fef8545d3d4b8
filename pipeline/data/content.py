"""Hashes of every dataset and attribute of an episode file, by name: they show what changed even if
the file's hash is forged."""

from collections.abc import Callable, Mapping
from typing import Any

import h5py
import numpy as np

from pipeline.data.keys import arrays_digest, digest, frames_digest

HASHES = "hashes"
"""The attribute of a file that holds them, as JSON."""

ATTRIBUTES = ("schema", "spec", "fps", "meta", "names", "name", "bodies", "joints")
"""The names of all attributes but HASHES, of a file and of its groups."""

HEADER = "header"
"""Name of what is in attributes: of the file, and of its groups."""


def content_hashes(file: h5py.File, read: Callable[[str], Any]) -> dict[str, str]:
    """sha256 (32 hex digits) of every dataset by its name, and of all attributes under HEADER;
    `read` returns a dataset, whole.

    Raises what h5py raises for a damaged file.
    """
    names, attributes = list[str](), {"": _plain(file.attrs)}

    def visit(name: str, found: Any) -> None:
        if isinstance(found, h5py.Dataset):
            names.append(name)
        elif len(found.attrs):
            attributes[name] = _plain(found.attrs)

    file.visititems(visit)
    return {name: _hash(read(name)) for name in names} | {HEADER: digest(attributes)}


def differing(a: Mapping[str, str], b: Mapping[str, str]) -> list[str]:
    """Names whose hashes differ, sorted."""
    return sorted(name for name in {*a, *b} if a.get(name) != b.get(name))


def _hash(values: Any) -> str:
    # texts are objects, one alone is no array where h5py reads it
    texts = (
        [values]
        if isinstance(values, bytes)
        else values.ravel().tolist()
        if values.dtype.hasobject
        else None
    )
    return (arrays_digest({"": np.asarray(values)}) if texts is None else frames_digest(texts))[:32]


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    if unknown := set(attributes) - {HASHES, *ATTRIBUTES}:
        raise ValueError(f"has the attribute {min(unknown)[:80]!r}, which no episode has")
    return {
        name: np.asarray(attributes[name]).tolist() for name in sorted(attributes) if name != HASHES
    }

"""HDF5 files, opened safely and written without crashes on a full disk."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5d, h5l, h5o, h5z  # pyright: ignore[reportAttributeAccessIssue]

from pipeline.data.keys import arrays_digest, digest, frames_digest
from pipeline.data.reading import check_regular

MOST = 10_000  # objects in a file, at most


def open_hdf5(path: Path) -> h5py.File:
    """Open for reading. Raises OSError for no regular HDF5 file, links, or two names for one
    object.
    """
    check_regular(path)
    # a finished file is never written again, and some file systems have no locks
    file = h5py.File(path, "r", locking=False)
    addresses = [h5o.get_info(file.id).addr]

    def visit(name: bytes, link: Any) -> str | None:
        addresses.append(link.u)
        if link.type != h5l.TYPE_HARD:
            return f"{name.decode(errors='replace')} is a link to elsewhere"
        return f"it has more than {MOST} objects" if len(addresses) > MOST else None

    try:
        problem = file.id.links.visit(visit, info=True)
        if not problem and len(set(addresses)) < len(addresses):
            problem = "an object in it has two names"
        if problem:
            raise OSError(problem)
    except BaseException:
        file.close()
        raise
    return file


def check_dataset(dataset: h5d.DatasetID) -> None:
    """Raise OSError unless values are chunks or one block in the file, plain or gzip."""
    made = dataset.get_create_plist()
    if made.get_layout() not in (h5d.CHUNKED, h5d.CONTIGUOUS) or made.get_external_count():
        raise OSError("its values are not stored in this file as chunks or one block")
    filters = {made.get_filter(number)[0] for number in range(made.get_nfilters())}
    if filters - {h5z.FILTER_DEFLATE, h5z.FILTER_SHUFFLE, h5z.FILTER_FLETCHER32}:
        raise OSError("it is compressed by a filter that is not gzip")


class _Kept(FileIO):
    """A file that ignores writes after the disk's first refusal (`refused`): HDF5 would crash."""

    refused: OSError | None = None

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            while self.refused is None and len(left):
                left = left[super().write(left) :]
        except OSError as error:
            self.refused = error
        return size

    def readinto(self, buffer: Any) -> int:
        # bytes that could not be written read as zeros
        count = super().readinto(buffer) or 0
        if self.refused is None:
            return count
        rest = memoryview(buffer).cast("B")[count:]
        rest[:] = bytes(len(rest))
        return count + len(rest)

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size) if self.refused is None else size or 0
        except OSError as error:
            self.refused = error
            return size or 0


@contextmanager
def new_hdf5(path: Path, **options: Any) -> Iterator[h5py.File]:
    """A new HDF5 file of an old, widely read version. Raises OSError at the block's end."""
    with _Kept(path, "w+") as kept:
        try:
            with h5py.File(kept, "w", libver=("v110", "v110"), **options) as file:
                yield file
        except (OSError, RuntimeError, ValueError, KeyError):
            if kept.refused is None:
                raise
        if kept.refused is not None:
            raise OSError(kept.refused.errno, kept.refused.strerror, str(path)) from kept.refused


HASHES = "hashes"  # the attribute of a file that holds them, as JSON
HEADER = "header"  # name of the hash of all attributes


def content_hashes(file: h5py.File, read: Callable[[h5py.Dataset], Any]) -> dict[str, str]:
    """sha256 (32 hex digits) of every dataset by name, and of all attributes under HEADER."""
    datasets, attributes = dict[str, h5py.Dataset](), {"": _plain(file.attrs)}

    def visit(name: str, found: Any) -> None:
        if isinstance(found, h5py.Dataset):
            datasets[name] = found
        elif len(found.attrs):
            attributes[name] = _plain(found.attrs)

    file.visititems(visit)
    return {name: _hash(read(d)) for name, d in datasets.items()} | {HEADER: digest(attributes)}


def differing(a: Mapping[str, str], b: Mapping[str, str]) -> list[str]:
    """Names whose hashes differ, sorted."""
    return sorted(name for name in {*a, *b} if a.get(name) != b.get(name))


def _hash(values: Any) -> str:
    if isinstance(values, bytes):  # one text alone is no array where h5py reads it
        return frames_digest([values])[:32]
    if values.dtype.hasobject:
        return frames_digest(values.ravel().tolist())[:32]
    return arrays_digest({"": np.asarray(values)})[:32]


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: np.asarray(attributes[name]).tolist() for name in sorted(attributes) if name != HASHES
    }

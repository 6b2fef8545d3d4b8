"""HDF5 files being written."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py


@contextmanager
def new_hdf5(path: Path, **options: Any) -> Iterator[h5py.File]:
    """A new HDF5 file, of a version that readers of ten years know; `options` are h5py.File's.

    Raises OSError with the system's number and text where the disk refuses. HDF5 itself says so in several lines, and in a
    RuntimeError without a number when it finds out while it closes the file.
    """
    try:
        with h5py.File(path, "w", libver=("v110", "v110"), **options) as file:
            yield file
    except (OSError, RuntimeError) as error:
        said = re.search(r"\berrno = (\d+)", str(error))
        if said is None:
            raise
        number = int(said[1])
        raise OSError(number, os.strerror(number), str(path)) from error

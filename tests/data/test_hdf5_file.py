"""HDF5 files on a disk that refuses: what HDF5 raises, with its own wording, becomes the system's error."""

import errno

import h5py
import numpy as np
import pytest

from pipeline.data.hdf5_file import new_hdf5

LONG = (
    "(file write failed: time = Sun Nov 22 12:53:05 2026\n, filename = 'a', file descriptor = 3, errno = 28, error message = 'x')"
)


@pytest.mark.parametrize(
    "raised",
    [RuntimeError(f"Can't decrement id ref count {LONG}"), OSError(errno.ENOSPC, f"Can't synchronously write data {LONG}")],
)
def test_a_full_disk_is_an_error_of_the_system_in_one_line(tmp_path, raised):
    path = tmp_path / "a.h5"
    with pytest.raises(OSError, match="No space left on device") as refused, new_hdf5(path):
        raise raised
    assert (refused.value.errno, refused.value.filename) == (errno.ENOSPC, str(path)) and "\n" not in str(refused.value)


def test_a_disk_that_is_full_when_the_file_is_closed(tmp_path, monkeypatch):
    close = h5py.File.close

    def refused(file):
        close(file)
        raise RuntimeError(f"Disable slist on flush dest failure failed {LONG}")

    monkeypatch.setattr(h5py.File, "close", refused)
    with pytest.raises(OSError, match="No space left on device"), new_hdf5(tmp_path / "a.h5") as file:
        file["x"] = np.arange(3)


@pytest.mark.parametrize("raised", [RuntimeError("unlucky"), OSError("odd"), KeyError("x")])
def test_other_errors_pass(tmp_path, raised):
    with pytest.raises(type(raised)) as passed, new_hdf5(tmp_path / "a.h5"):
        raise raised
    assert passed.value is raised


def test_what_is_written_is_read(tmp_path):
    with new_hdf5(tmp_path / "a.h5", rdcc_nbytes=2**20) as file:
        file["x"] = np.arange(3)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["x"][:].tolist() == [0, 1, 2]

"""HDF5 files: the error of a disk that refuses is one line of the system; nothing stays open."""

import errno
import fcntl

import h5py
import numpy as np
import pytest

from pipeline.data.episode.hdf5 import new_hdf5, open_hdf5
from tests.full_disk import longest_file


def left_open():
    return h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE)


def write(path):
    with new_hdf5(path, rdcc_nbytes=2**16) as file:
        for group in "abc":
            file.create_dataset(f"{group}/chunks", data=np.ones((6, 100)), chunks=(1, 100))
            file[f"{group}/texts"] = np.array(["x" * 50] * 20, h5py.string_dtype())
            file[f"{group}/plain"] = np.arange(500.0)
            file[group].attrs["names"] = ["a"] * 40


def test_a_full_disk_is_one_error_of_the_system_wherever_it_is_met(tmp_path, capfd):
    path = tmp_path / "a.h5"
    write(path)
    whole, before = path.read_bytes(), left_open()
    for size in range(0, len(whole), 999):
        with pytest.raises(OSError, match="File too large") as refused, longest_file(size):
            write(path)
        assert (refused.value.errno, refused.value.filename) == (
            errno.EFBIG,
            str(path),
        ) and "\n" not in str(refused.value)
        assert left_open() == before
    write(path)
    assert path.read_bytes() == whole
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("raised", [RuntimeError("unlucky"), OSError("odd"), KeyError("x")])
def test_other_errors_pass(tmp_path, raised):
    with pytest.raises(type(raised)) as passed, new_hdf5(tmp_path / "a.h5"):
        raise raised
    assert passed.value is raised


def test_what_is_written_is_read(tmp_path):
    with new_hdf5(tmp_path / "a.h5", rdcc_nbytes=2**20) as file:
        file["x"] = np.arange(3)
    with open_hdf5(tmp_path / "a.h5") as file:
        assert file["x"][:].tolist() == [0, 1, 2]


def test_a_file_is_read_without_a_lock_of_its_file_system(tmp_path):
    write(tmp_path / "a.h5")
    with open(tmp_path / "a.h5", "rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with open_hdf5(tmp_path / "a.h5") as file:
            assert len(file["a/plain"]) == 500

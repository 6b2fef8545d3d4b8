"""What garbage collection looks at, and what the C heap holds."""

import ctypes
import gc
from pathlib import Path

import pytest

from pipeline.data.process.machine import freeze_garbage, trim


def test_a_block_looks_at_new_objects_only():
    old = [{"a": []} for _ in range(1000)]
    before = gc.get_freeze_count()
    with freeze_garbage():
        assert gc.get_freeze_count() >= before + len(old)
        new: list[object] = []
        new.append(new)
        assert any(each is new for each in gc.get_objects())
        assert not any(each is old for each in gc.get_objects())
    assert gc.get_freeze_count() == 0
    assert any(each is old for each in gc.get_objects())


def test_an_error_leaves_nothing_out():
    with pytest.raises(ValueError, match="why"), freeze_garbage():
        raise ValueError("why")
    assert gc.get_freeze_count() == 0


def resident() -> int:
    """Resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def test_free_pages_below_the_newest_allocation_go_back():
    libc = ctypes.CDLL(None)
    libc.malloc.restype = libc.memset.restype = ctypes.c_void_p
    libc.malloc.argtypes, libc.free.argtypes = [ctypes.c_size_t], [ctypes.c_void_p]
    libc.memset.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_size_t]
    size, count = 100_000, 1000  # below the size from which each gets pages of its own
    blocks = [libc.malloc(size) for _ in range(count + 1)]
    for block in blocks:
        libc.memset(block, 1, size)
    for block in blocks[:-1]:
        libc.free(block)
    held = resident()
    trim()
    freed = held - resident()
    libc.free(blocks[-1])
    assert freed > 0.9 * size * count

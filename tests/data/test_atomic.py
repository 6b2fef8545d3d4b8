"""Files and directories are whole or absent, whatever happens to who writes them."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.data import atomic as module
from pipeline.data.atomic import atomic_directory, atomic_path, sweep, temporary_name, write_atomic

ROOT = Path(__file__).parents[2]


def everything(root):
    return sorted(p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file())


def test_a_file_is_replaced_whole(tmp_path):
    path = tmp_path / "deep" / "file"
    write_atomic(path, b"old")
    write_atomic(path, b"new")
    assert path.read_bytes() == b"new"
    assert everything(tmp_path) == ["deep/file"]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, call):
    write_atomic(tmp_path / "file", b"old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module.os, call, full)
    with pytest.raises(OSError, match="space"):
        write_atomic(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"old"
    assert everything(tmp_path) == ["file"]


def test_a_killed_writer_never_leaves_half_a_file(tmp_path):
    code = f"""
import itertools, sys
sys.path.insert(0, {str(ROOT)!r})
from pathlib import Path
from pipeline.data.atomic import write_atomic
for n in itertools.count():
    write_atomic(Path({str(tmp_path)!r}) / "file", bytes([n % 251]) * 2_000_000)
"""
    child = subprocess.Popen([sys.executable, "-c", code])
    try:
        began = time.monotonic()
        while not (tmp_path / "file").exists():
            assert time.monotonic() - began < 60
            time.sleep(0.01)
        time.sleep(0.05)
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    data = (tmp_path / "file").read_bytes()
    assert len(data) == 2_000_000
    assert set(data) == {data[0]}


def test_a_block_that_fails_leaves_the_old_directory(tmp_path):
    out = tmp_path / "export"
    with atomic_directory(out) as new:
        (new / "a").write_text("1")
    with pytest.raises(ValueError, match="no"), atomic_directory(out) as new:
        (new / "a").write_text("2")
        raise ValueError("no")
    assert everything(tmp_path) == ["export/a"]
    assert (out / "a").read_text() == "1"
    with atomic_directory(out) as new:
        (new / "b").write_text("3")
    assert everything(tmp_path) == ["export/b"]


def test_a_directory_set_aside_by_a_killed_process_is_put_back(tmp_path):
    (tmp_path / ".export.old").mkdir()
    (tmp_path / ".export.old" / "a").write_text("1")
    with pytest.raises(ValueError, match="no"), atomic_directory(tmp_path / "export"):
        raise ValueError("no")
    assert everything(tmp_path) == ["export/a"]


def test_only_what_dead_processes_of_this_host_left_is_swept(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    host = socket.gethostname()
    dead = tmp_path / "deep" / f".a.hdf5.{host}.{child.pid}.tmp"
    dead.parent.mkdir()
    dead.write_text("x")
    (tmp_path / f".export.{host}.{child.pid}.tmp").mkdir()
    mine = temporary_name(tmp_path / "b.hdf5")
    mine.write_text("x")
    other = tmp_path / f".c.elsewhere.{child.pid}.tmp"
    other.write_text("x")
    assert sweep(tmp_path) == 2
    assert sorted(tmp_path.iterdir()) == sorted([dead.parent, mine, other])
    assert everything(dead.parent) == []


def test_what_a_zombie_left_is_swept(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", ""])
    left = tmp_path / f".a.{socket.gethostname()}.{child.pid}.tmp"
    left.touch()
    # waits for its end and leaves it a zombie
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    assert sweep(tmp_path) == 1
    child.wait()


def test_a_failed_write_is_not_renamed(tmp_path):
    with pytest.raises(ValueError, match="half"), atomic_path(tmp_path / "x") as temporary:
        temporary.write_bytes(b"half")
        raise ValueError("half")
    assert everything(tmp_path) == []

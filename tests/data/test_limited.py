"""A child process takes no more than it may, whatever the code in it does."""

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from pipeline.data.errors import DominoError
from pipeline.data.process.limited import LimitError, Limits, run_limited

SMALL = Limits(memory=300 << 20, processor=2, wall=20.0, file=1 << 20)


def double(x):
    print("not seen")
    return 2 * x


def refuse(name):
    raise DominoError(f"{name}: is no number")


def leave(how):
    if how == "exit":
        sys.exit(3)
    if how == "kill":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how == "base":
        raise type("Odd", (BaseException,), {})("two\nlines")
    if how == "close":
        sys.stdout.close()
        os.closerange(0, 100)
    if how == "sleep":
        subprocess.Popen(["sleep", "100"])
        time.sleep(100)
    if how == "memory":
        np.ones(10**8)
    if how == "spin":
        while True:
            pass
    if how == "file":
        with open("big", "wb") as file:
            file.write(bytes(2 << 20))
    if how == "lambda":
        return lambda: None
    return how


def test_the_value_comes_back_also_from_a_thread(capfd):
    assert run_limited("a", double, 21) == 42
    found = []
    thread = threading.Thread(target=lambda: found.append(run_limited("a", double, np.arange(3))))
    thread.start()
    thread.join()
    assert found[0].tolist() == [0, 2, 4] and capfd.readouterr() == ("", "")
    with pytest.raises(DominoError, match="seven: is no number"):
        run_limited("a", refuse, "seven")


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("exit", "raised SystemExit: 3"),
        ("kill", "ended its process by SIGSEGV"),
        ("base", "raised Odd: two lines"),
        ("close", "ended its process with exit code"),
        ("sleep", "takes longer than 2 s"),
        ("memory", "needs more than 300 MiB of memory"),
        ("spin", "takes more than 2 s of processor time"),
        ("file", r"raised OSError: .*File too large"),
        ("lambda", "ended its process with exit code"),
    ],
)
def test_whatever_it_does_it_ends_in_one_line(tmp_path, monkeypatch, how, words):
    monkeypatch.chdir(tmp_path)
    began, usual = time.monotonic(), set(os.listdir("/proc/self/fd"))
    limits = replace(SMALL, wall=2.0 if how == "sleep" else SMALL.wall)
    with pytest.raises(LimitError, match=f"^file.urdf: {words}") as error:
        run_limited("file.urdf", leave, how, limits=limits)
    assert "\n" not in str(error.value) and time.monotonic() - began < 30
    assert len(os.listdir("/proc/self/fd")) == len(usual)

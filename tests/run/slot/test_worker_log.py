"""What is printed at a slot goes to its log, which stays only where something went wrong."""

import os
import signal
import subprocess
import sys

import pytest

from pipeline.run.slot.fill import worker_log


def test_a_log_of_what_went_well_is_removed(tmp_path, capfd):
    path = tmp_path / "cell" / "a.log"
    print("before")
    with worker_log(path):
        print("within")
        os.write(2, b"from a library\n")
        sys.stdout.flush()
        assert path.read_text() == "within\nfrom a library\n"
    print("after")
    assert capfd.readouterr().out == "before\nafter\n"
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_is_wanted_stays_and_grows(tmp_path):
    path = tmp_path / "a.log"
    for text in ("first", "second"):
        with worker_log(path) as log:
            print(text)
            log.keep = True
    assert path.read_text() == "first\nsecond\n"


def test_an_error_leaves_its_traceback(tmp_path):
    with pytest.raises(ValueError, match="broken") as error, worker_log(tmp_path / "a.log"):
        print("said before")
        raise ValueError("broken")
    text = (tmp_path / "a.log").read_text()
    assert "said before" in text and "ValueError: broken" in text and "Traceback" in text
    assert str(tmp_path / "a.log") in "".join(error.value.__notes__)


def test_a_crash_leaves_where_it_happened(tmp_path):
    code = (
        "import os, signal\nfrom pathlib import Path\nfrom pipeline.run.slot.fill import"
        f" worker_log\nwith worker_log(Path({str(tmp_path / 'a.log')!r})):\n   "
        " os.kill(os.getpid(), signal.SIGSEGV)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert ended.returncode == -signal.SIGSEGV and ended.stderr == ""
    assert "Segmentation fault" in (tmp_path / "a.log").read_text()

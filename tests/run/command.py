"""The real command in a process of its own, and what it must have made whoever did the work."""

import io
import os
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pipeline.cli import main
from pipeline.data.dataset import Dataset
from tests.run.processes import wait_for

ROOT = Path(__file__).parents[2]
COMMAND = Path(sys.executable).with_name("domino-data")
WANTED = ("--manifest", Path(__file__).with_name("small.yaml"))
PATIENCE = 400


def start(*arguments, extra=None, new_session=False):
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | (extra or {})
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(
        [COMMAND, *map(str, arguments)], env=environment, start_new_session=new_session, **pipes
    )


def run(*arguments, code=0, extra=None):
    """Run the command to its end; its standard output, or its standard error where it must fail
    with `code`."""
    process = start(*arguments, extra=extra)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == code, f"{arguments}: {process.returncode}\n{out}\n{err}"
    assert "Traceback" not in err
    return out if code == 0 else err


def inside(*arguments):
    """The command in this process, which saves its start: exit code, standard output, standard
    error."""
    out, err = io.StringIO(), io.StringIO()
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["domino-data", *map(str, arguments)])
        try:
            main()
            code = 0
        except SystemExit as leave:
            code = leave.code or 0
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
    return code, out.getvalue(), err.getvalue()


def build(out, *more, **options):
    return run("build", *WANTED, "--out", out, "--quiet", *more, **options)


def slots(out):
    dataset = Dataset(out)
    return (
        sorted(slot.path for slot in dataset.rows(dataset.recipe()).slots)
        if dataset.index.exists()
        else []
    )


def wait_for_a_slot(out, process):
    """Wait until a dataset has a finished slot or the process that makes it ended. Looks for files
    first: to read recipe and index at every turn would cost as much as the build."""
    wait_for(
        lambda: process.poll() is not None or (any(out.glob("episodes/**/*.hdf5")) and slots(out)),
        PATIENCE,
    )


def contents(out, timed=True):
    """What must not depend on who built it: bytes of episodes, records and attempts without times,
    recipe and provenance."""
    records, dataset = {}, Dataset(out)
    for slot, record in dataset.records(dataset.recipe()):
        assert record.file.changed and record.file.assets
        assert record.seconds > 0 or not timed
        assert all(row.pop("seconds", 0) > 0 or not timed for row in record.attempts)
        records[slot] = replace(
            record, seconds=0.0, core_seconds=0.0, file=replace(record.file, changed=0)
        )
    rows = pq.read_table(out / "attempts.parquet").drop_columns("seconds").to_pylist()
    files = [*out.glob("episodes/**/*.*"), out / "manifest.yaml", out / "provenance.json"]
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in files}, records, rows


def temporaries(out):
    return [p for p in out.rglob("*") if p.name.endswith(".tmp")]

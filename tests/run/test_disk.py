"""A disk that is full, gone or forbidden while a build runs: one line with the fix, exit code 2,
and what is finished stays."""

import errno
import os

import pytest

from pipeline.crew.contract import Done
from pipeline.data.dataset import Dataset
from pipeline.data.keys import file_hash
from pipeline.data.slots.records import FileFacts, SlotRecord
from pipeline.run import build
from pipeline.run.identity.slot_keys import RecipeKeys
from tests.run.command import WANTED, inside


def failing_after_one(number):
    """An engine whose second slot finds the disk in this state."""

    def run(make, jobs, *_):
        job = jobs.popleft()
        path = Dataset(job.root).episode(job.slot)
        path.parent.mkdir(parents=True)
        path.write_bytes(b"an episode")
        row = {
            "attempt": 0,
            "seed": job.recipe.spec(job.slot, 0).seed,
            "outcome": "accepted",
            "reason": "",
            "seconds": 1.0,
        }
        keys, facts = RecipeKeys(job.recipe).of(job.slot), FileFacts.of(path.stat(), 3)
        yield Done(job, SlotRecord(keys, True, file_hash(path), (row,), file=facts))
        raise OSError(number, os.strerror(number), "/mnt/set/episodes/e.hdf5")

    return run


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.ENOSPC, "No space left on device: free some space;"),
        (errno.EDQUOT, "Disk quota exceeded: free some space or raise the quota;"),
        (errno.EACCES, "Permission denied: give this user the permission;"),
        (errno.EFBIG, "File too large: raise the limit of file sizes (ulimit -f);"),
        (errno.EROFS, "Read-only file system: make it writable;"),
        (
            errno.ENOTCONN,
            "Transport endpoint is not connected: the mount is gone or broken: mount it again;",
        ),
        (errno.ESTALE, "Stale file handle: the mount is gone or broken: mount it again;"),
        (errno.EIO, "Input/output error: the mount is gone or broken: mount it again;"),
    ],
)
def test_a_disk_that_fails_is_one_line_and_what_is_finished_stays(
    tmp_path, monkeypatch, number, said
):
    monkeypatch.setattr(build, "run", failing_after_one(number))
    out = tmp_path / "set"
    code, _, err = inside("build", *WANTED, "--out", out, "--quiet", "--executor", "inline")
    wanted = (
        f"domino-data: /mnt/set/episodes/e.hdf5: {said} finished work is kept; rerun the same"
        " command to resume\n"
    )
    assert (code, err) == (2, wanted)
    dataset = Dataset(out)
    assert [path.read_bytes() for path in dataset.accepted(dataset.recipe())] == [b"an episode"]
    assert not list(out.rglob("*.tmp"))

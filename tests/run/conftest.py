"""A dataset that the tests of this folder share."""

import pytest
from filelock import FileLock

from tests.run.command import WANTED, inside


@pytest.fixture(scope="session")
def built(tmp_path_factory, worker_id):
    """A finished dataset of three episodes, made once for all test processes; nobody writes to
    it."""
    base = tmp_path_factory.getbasetemp()
    shared = (base if worker_id == "master" else base.parent) / "built-once"
    with FileLock(f"{shared}.lock"):
        if not (shared / "report" / "index.html").exists():
            code, _, err = inside(
                "build", *WANTED, "--out", shared, "--quiet", "--executor", "inline"
            )
            assert code == 0, err
    return shared


@pytest.fixture
def without_report(monkeypatch):
    """Builds and renderings in this process write no HTML page, which takes most of a second:
    `built` has one."""
    monkeypatch.setattr("pipeline.report.page.write_report", lambda root, *_: root)

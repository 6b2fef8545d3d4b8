"""Shared by all tests. Its being here makes pytest put the repository root first on the path, so
that `tests.synthetic` is ours."""

import gc
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import typer.main
from hypothesis import settings

from pipeline.crew.contract import Crew
from pipeline.crew.ray_session import session

# many short processes start: let them reuse bytecode, as `make test` does
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# what tests import stays: to look for garbage among it takes a tenth of the time of the imports
gc.disable()

# whatever test imports Ray first: its own runs listen on loopback
os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"

# what a busy machine delays is no failure; each run draws other examples, so few are enough
settings.register_profile("any_machine", deadline=None, max_examples=30)
settings.load_profile("any_machine")

TORCH = (
    *(
        "annotate/test_model",
        "evaluate/policies/test_adapters.py",
        "export/formats/lerobot/test_meta.py",
        "export/formats/lerobot/test_reference.py",
        "lerobot_env/",
        "lerobot_policy/",
        "report/test_card.py",
    ),
    *("training/ladder/test_climb.py", "training/puma/"),
)
"""Tests that import lerobot or models of transformers, which takes 8 s of CPU."""

SLOW = (
    *(
        "run/test_on_a_store.py",
        "run/test_build.py",
        "run/test_faults.py",
        "run/test_renew.py",
        "crew/test_ray_session.py",
    ),
    *("run/test_render.py", "evaluate/test_evaluate.py", "tasks/test_tasks.py"),
)
"""Files with tests of 4 s and more."""


def pytest_collection_modifyitems(items):
    """Put the tests that import lerobot or transformers first, so that one test process has them
    all: others take work from the end of its list. Put slow tests next, so that no process waits
    for one of them at the end."""
    names = {item: item.nodeid.removeprefix("tests/") for item in items}
    items.sort(
        key=lambda item: (not names[item].startswith(TORCH), not names[item].startswith(SLOW))
    )


def pytest_collection_finish():
    """Collect garbage from now on, of what the tests themselves make."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def without_waiting_for_the_disk():
    """No test cuts the power: what is written need not be on the disk before a test goes on."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def one_parser_for_all_commands():
    """A process makes the parser of its command line once, which is most of what a refused command
    costs: so do the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", cache(typer.main.get_command))
        yield


@pytest.fixture(scope="module")
def tests_path() -> Iterator[None]:
    """Processes that start within can import tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
        yield


@pytest.fixture(scope="module")
def ray_session(tests_path: None):
    """Ray with two workers for the tests of a module."""
    with session(Crew("ray", 2)):
        yield

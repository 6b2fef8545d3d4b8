"""Bad input ends with one line that names the thing, exit code 2 and no change on disk, in bounded
time and memory."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands.bad_input import CASES, attempt
from tests.commands.bad_places import furnish

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    root = tmp_path_factory.mktemp("bad")
    furnish(root)
    return root


@pytest.mark.parametrize(
    "case",
    [
        # most differ in the value alone: every other one is left to the slow tests
        pytest.param(case, marks=[pytest.mark.slow] * (number % 2), id=case.name)
        for number, case in enumerate(CASES)
    ],
)
def test_bad_input_is_one_line(case, place):
    assert attempt(case, place).fault(case) == ""


def test_there_are_at_least_150_cases():
    assert len({(case.words, case.said) for case in CASES}) == len(CASES) >= 150


def test_a_process_ends_with_exit_code_2_and_one_line(place):
    command = [
        sys.executable,
        "-m",
        "pipeline.cli",
        "plan",
        "--manifest",
        place / "recipes" / "bomb.yaml",
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=ROOT, timeout=120
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "bomb.yaml" in done.stderr and "Traceback" not in done.stderr

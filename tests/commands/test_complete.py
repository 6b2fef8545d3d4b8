"""Shell completion: the command itself answers what a shell asks it, and the names are those of the
registries."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.commands import options
from pipeline.tasks import TASKS
from pipeline.world.robots import MODELS

COMMAND = Path(sys.executable).with_name("domino-data")


def completed(line: str) -> list[str]:
    """What a bash with this line offers for its last word."""
    environment = {
        "_DOMINO_DATA_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(line.count(" ")),
    }
    done = subprocess.run(
        [COMMAND],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        (
            "domino-data build --tasks beat_block_hammer,sha",
            [f"beat_block_hammer,shake_bottle{end}" for end in ("", "_horizontally")],
        ),
        ("domino-data export --fo", ["--format"]),
    ],
)
def test_the_command_completes(line, wanted):
    assert completed(line) == wanted


def test_names_are_those_of_the_registries():
    assert set(options.complete_task("")) == set(TASKS) and set(options.complete_tasks("")) == {
        *TASKS,
        "all",
    }
    assert set(MODELS) <= set(options.complete_robot("")) and options.complete_robots(
        "piper,ur5-"
    ) == ["piper,ur5-wsg"]

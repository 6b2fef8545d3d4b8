"""The job array of docs/cluster.md: its syntax, and what its commands select."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pipeline import cli
from pipeline.gym_ids import shipped_tasks

PAGE = Path(__file__).parents[1] / "docs" / "cluster.md"


def script(language: str) -> str:
    (found,) = re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    subprocess.run(["bash", "-n"], input=found, text=True, check=True)
    return found


@pytest.mark.skipif(shutil.which("jq") is None, reason="the script asks for jq")
def test_each_job_of_the_array_builds_a_task_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    text = script("sbatch")
    monkeypatch.setattr("sys.argv", ["domino-data", "tasks", "--json"])
    with pytest.raises(SystemExit):
        cli.main()
    (tmp_path / "tasks.json").write_text(capsys.readouterr().out)
    (tmp_path / "domino-data").write_text(
        f'#!/bin/sh\n[ "$1" = tasks ] && cat {tmp_path}/tasks.json || echo "$@"\n'
    )
    (tmp_path / "domino-data").chmod(0o755)
    jobs = re.search(r"--array=1-(\d+)", text)
    assert jobs
    built = list[str]()
    for number in (1, 2, int(jobs[1])):
        environment = {"SLURM_ARRAY_TASK_ID": str(number), "SCRATCH": "/scratch"}
        environment["PATH"] = f"{tmp_path}:/usr/bin:/bin"
        line = subprocess.run(
            ["bash", "-c", text], env=environment, capture_output=True, text=True, check=True
        ).stdout.split()
        with cli.Verbs().commands["build"].make_context("build", line[1:]) as context:
            built.append(str(context.params["tasks"]))
            assert context.params["executor"] == "inline"
    assert built == [*shipped_tasks()[:2], shipped_tasks()[-1]]


def test_a_lost_machine_does_not_end_the_job():
    text = script("slurm")
    assert "#SBATCH --no-kill\n" in text and "srun --no-kill --kill-on-bad-exit=0" in text

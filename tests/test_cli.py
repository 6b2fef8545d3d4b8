"""The `domino-data` command itself; its verbs are tested with what they call."""

import tomllib
from pathlib import Path

import pytest

from pipeline import cli

ROOT = Path(__file__).parent.parent


def run(*words: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """The exit code of the command with these words."""
    monkeypatch.setattr("sys.argv", ["domino-data", *words])
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    return int(stopped.value.code or 0)


def test_the_version_is_that_of_the_project_file(monkeypatch, capsys):
    assert run("--version", monkeypatch=monkeypatch) == 0
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert capsys.readouterr().out == f"domino-data {project['version']}\n"


def test_help_lists_every_verb(monkeypatch, capsys):
    assert run("--help", monkeypatch=monkeypatch) == 0
    shown = capsys.readouterr().out
    assert (
        all(verb.__name__.replace("_", "-") in shown for verb in cli.VERBS) and "--version" in shown
    )


def test_an_expected_error_is_one_line_and_exit_code_2(monkeypatch, capsys, tmp_path):
    assert run("status", str(tmp_path / "nowhere"), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.startswith("domino-data: ") and error.count("\n") == 1 and "nowhere" in error


def test_an_interrupt_is_exit_code_130_and_no_traceback(monkeypatch, capsys):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.intake.catalogue.tasks.listing", interrupted)
    assert run("tasks", monkeypatch=monkeypatch) == 130
    assert capsys.readouterr().err == ""

"""The `domino-data` command itself; its verbs are tested with what they call."""

import re
import subprocess
import sys
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
    assert all(f" {verb} " in shown for verb in cli.PLACES) and "--version" in shown


def test_help_imports_no_verb_and_says_what_each_says_itself():
    code = "import sys; from pipeline import cli; cli.main()"
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", code, "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert not re.search(r"\b(numpy|pydantic|pipeline\.commands\.build)$", done.stderr, re.M)
    verbs = cli.Verbs()
    for name, command in verbs.commands.items():
        said = (command.help or "").split("\n")[0]
        assert said and verbs.get_command(None, name).help.startswith(said), name


def test_an_expected_error_is_one_line_and_exit_code_2(monkeypatch, capsys, tmp_path):
    assert run("status", str(tmp_path / "nowhere"), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.startswith("domino-data: ") and error.count("\n") == 1 and "nowhere" in error


def test_an_interrupt_is_exit_code_130_and_no_traceback(monkeypatch, capsys):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.intake.catalogue.listings.list_tasks", interrupted)
    assert run("tasks", monkeypatch=monkeypatch) == 130
    assert capsys.readouterr().err == ""

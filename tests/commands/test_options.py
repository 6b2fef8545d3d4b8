"""Options of every command have bounds, and errors end every command in one line."""

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer import TyperException
from typer.core import TyperCommand
from typer.main import get_command

from pipeline.cli import app
from pipeline.commands.command import Verb, run_app
from training.puma.cli import app as puma


def commands() -> Iterator[tuple[str, TyperCommand]]:
    """Every command, with the words that call it."""
    todo: list[tuple[str, Any]] = [("domino-data", get_command(app)), ("puma", get_command(puma))]
    while todo:
        words, command = todo.pop()
        if isinstance(command, TyperCommand):
            yield words, command
        else:
            todo += [(f"{words} {name}", each) for name, each in command.commands.items()]


def test_every_number_has_bounds():
    for words, command in commands():
        params: list[Any] = command.params
        for param in params:
            kind, info = param.type_descriptor.annotation, param.type_descriptor.parameter_info
            if kind in (int, float):
                assert math.isfinite(info.min) and math.isfinite(info.max), (words, param.name)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e400", "ten", "", "--1", "1,2"])
def test_what_is_no_number_within_the_bounds_is_refused(text):
    (build,) = (command for words, command in commands() if words == "domino-data build")
    with pytest.raises(TyperException):
        build.main([f"--slot-timeout={text}"], standalone_mode=False)


def raising(error: BaseException) -> typer.Typer:
    verbs = typer.Typer(pretty_exceptions_enable=False)

    @verbs.command(cls=Verb)
    def verb() -> None:
        raise error

    return verbs


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ValueError("a\nb \x1b[31m"), 2),
        (RecursionError(), 2),
        (OSError(28, "No space", "x"), 2),
        (KeyboardInterrupt(), 130),
    ],
)
def test_errors_are_one_line(error, code, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["verb"])
    with pytest.raises(SystemExit) as end:
        run_app(raising(error), "domino-data")
    out, err = capsys.readouterr()
    assert (end.value.code, out, err.count("\n")) == (code, "", code == 2) and "\x1b" not in err
    logs = list(tmp_path.iterdir())
    if isinstance(error, ValueError | RecursionError):  # which nobody foresaw
        assert err.rstrip().endswith(str(logs[0]))
        assert f"raise error\n{type(error).__name__}" in Path(logs[0]).read_text()
    else:
        assert not logs

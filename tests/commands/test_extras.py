"""A module of an extra that is not installed."""

import re
import tomllib
from pathlib import Path

import pytest
import typer

from pipeline.commands.command import EXTRAS, describe_missing, run_app

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]


def test_every_extra_that_a_message_names_brings_its_module():
    names = {"huggingface_hub": "huggingface-hub", "zmq": "pyzmq"}
    for module, extra in EXTRAS.items():
        needed = PROJECT["optional-dependencies"][extra]
        found = {re.split(r"[\[<>=]", requirement)[0] for requirement in needed}
        assert names.get(module, module) in found, module


def test_a_missing_extra_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys):
    app = typer.Typer()

    @app.command()
    def publish() -> None:
        raise ModuleNotFoundError("no module", name="huggingface_hub.errors")

    with pytest.raises(SystemExit) as end:
        run_app(app, "domino-data", lambda: [])
    assert end.value.code == 2
    expected = "domino-data: this needs huggingface_hub: uv pip install 'domino-data[hub]'\n"
    assert capsys.readouterr().err == expected


def test_a_module_of_ours_belongs_to_no_extra():
    assert describe_missing("pipeline.nowhere") == ""

"""Tables of what exists, and defaults in the help of verbs."""

import re

import click
import pytest
import typer
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.commands.common import table
from pipeline.data.recipe.model import Recipe
from pipeline.motion.models import MODELS
from pipeline.tasks import TASKS


def shown(*words: str) -> str:
    result = CliRunner().invoke(app, list(words), env={"COLUMNS": "200", "TERM": "dumb"})
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_table_has_its_columns_under_their_headers():
    text = table(("name", "m"), [("a", 1.5), ("long name", 10)])
    assert text.splitlines() == ["name         m", "a          1.5", "long name   10"]


def test_tasks_are_one_line_each_under_headers_with_units():
    header, *rows = shown("tasks").splitlines()
    assert "(frames)" in header
    assert [row.split()[0] for row in rows] == sorted(TASKS)
    bell = next(row for row in rows if row.startswith("click_bell"))
    assert str(TASKS["click_bell"].step_limit) in bell.split() and bell.endswith("(bell)")
    # descriptions that go on over a line of the docstring are whole
    assert next(row for row in rows if row.startswith("dump_bin_bigbin")).count("(") == 1


def test_robots_have_headers_with_units():
    header, *rows = shown("embodiments").splitlines()
    assert "opening (m)" in header and len(rows) >= 5


@pytest.mark.parametrize("verb", ["build", "plan"])
def test_help_says_the_defaults_of_a_recipe(verb):
    text = " ".join(re.sub("[│╭╮╰╯─]", " ", shown(verb, "--help")).split())
    for name, key in (
        ("--levels", "levels"),
        ("--episodes", "episodes"),
        ("--render", "render"),
        ("--attempts", "attempts"),
    ):
        default = Recipe.model_fields[key].default
        words = ",".join(map(str, default)) if isinstance(default, tuple) else str(default)
        assert re.search(rf"{name}\b.*?\[default: \(?([^\])]*)", text)[1] == words


def test_every_option_with_a_default_shows_it():
    group = typer.main.get_command(app)
    assert isinstance(group, click.Group | typer.core.TyperGroup)
    hidden = [
        (verb, option.name)
        for verb, command in group.commands.items()
        for option in command.params
        if getattr(option, "opts", [""])[0].startswith("--") and option.name != "help"
        if option.default not in (None, False) and not option.show_default
    ]
    assert hidden == []


def test_motions_are_listed_by_model_and_level():
    rows = shown("motions").splitlines()[1:]
    assert {row.split()[0] for row in rows} == set(MODELS) and len(rows) == 3 * len(MODELS)
    assert any(row.startswith("conveyor") and "load_belt_plate" in row for row in rows)
